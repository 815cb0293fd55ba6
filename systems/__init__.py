"""What perceives: simulated sensors and recursive filters. Nothing here knows the plant's truth."""
