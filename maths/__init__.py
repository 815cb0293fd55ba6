"""Mathematics shared by systems and controllers: Lie groups and Gaussian beliefs."""

from crossmodal.maths import compiled_cache

compiled_cache.use()
