"""Images of triangles: which of them is in front at each pixel."""

import numpy as np

from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.compiled import hot


@hot
def rasterise(corners: Array, owners: Ids, height: int, width: int) -> tuple[Array, Ids]:
    """The image of triangles whose largest third coordinate is in front.

    That coordinate must be linear in the other two on each triangle: a height for a view from
    above, one over the depth for a pinhole camera.

    Args:
        corners: (T, 3, 3): column and row [px], and the third coordinate.
        owners: Of each triangle (T,), zero or above.
        height: Of the image, [px].
        width: Likewise.

    Returns:
        The third coordinate (height, width), -inf where there is no triangle, and whose it is, -1.
    """
    front = np.full((height, width), -np.inf)
    owner = np.full((height, width), -1)
    for t in range(len(corners)):
        a, b, c = corners[t, 0], corners[t, 1], corners[t, 2]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area == 0.0:
            continue
        first_row = max(int(np.ceil(min(a[1], b[1], c[1]))), 0)
        last_row = min(int(np.floor(max(a[1], b[1], c[1]))), height - 1)
        first = max(int(np.ceil(min(a[0], b[0], c[0]))), 0)
        last = min(int(np.floor(max(a[0], b[0], c[0]))), width - 1)
        for v in range(first_row, last_row + 1):
            for u in range(first, last + 1):
                p = ((u - a[0]) * (c[1] - a[1]) - (v - a[1]) * (c[0] - a[0])) / area
                q = ((b[0] - a[0]) * (v - a[1]) - (b[1] - a[1]) * (u - a[0])) / area
                if p < 0.0 or q < 0.0 or p + q > 1.0:
                    continue
                w = a[2] + p * (b[2] - a[2]) + q * (c[2] - a[2])
                if w > front[v, u]:
                    front[v, u], owner[v, u] = w, owners[t]
    return front, owner
