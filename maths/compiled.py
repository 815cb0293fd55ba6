"""How the innermost loops are compiled.

Compiled code is kept in `__pycache__` and made anew when the file of a function changes, but not
when only a function that it calls in another file does: delete the folder after such a change.
"""

import numba

# Sums may be reordered and divisions are not checked; NaN and infinity keep their meaning.
hot = numba.njit(cache=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz", "arcp"})
