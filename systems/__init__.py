"""What perceives: simulated sensors, filters, smoothers. Nothing here knows the plant's truth."""

import crossmodal.maths  # noqa: F401  Before any function is compiled: it says where the code is kept.
