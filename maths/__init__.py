"""Mathematics shared by systems and controllers: Lie groups and Gaussian beliefs."""

from maths import compiled_cache

compiled_cache.use()
