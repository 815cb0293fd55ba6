"""What is simulated: robots, hands and objects put together into one MultibodyPlant."""
