"""Mathematics shared by systems and controllers: Lie groups and Gaussian beliefs."""
