"""How the innermost loops are compiled."""

import numba

# Sums may be reordered and divisions are not checked; NaN and infinity keep their meaning.
hot = numba.njit(cache=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})
