"""Whether a contact that was provoked to be lost came back, and when."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from crossmodal.diagrams.flap.results.flap_episode import TrueFlap
from crossmodal.diagrams.flap.results.flap_measures import lasting_from
from crossmodal.plants.tools.flap_jerk import FlapJerk

KEPT = 1.0  # A contact that lasts so long has come back, [s].


def recovery(truth: TrueFlap, jerk: FlapJerk) -> dict[str, Any] | None:
    """What became of the contact after one jerk of the flap; None where the flip was over before.

    Returns:
        `start` of the jerk, [s]; the `displacement` of the contact's place on the flap in it, as it
        truly came about, [m], NaN where it was not touched before; `contact_lost`, whether the
        contact broke off before the finger left the flap for good; `reestablished_after`, since the
        jerk began, until a contact that lasted, [s]: 0 where none was lost, NaN where it did not
        come back.
    """
    times = truth.times[truth.times < truth.retreated_at]
    after = np.flatnonzero(times > jerk.start)
    if len(after) == 0:
        return None
    index = int(after[0])
    before, end = max(index - 1, 0), min(int(np.searchsorted(times, jerk.end)), len(times) - 1)
    lever = float(np.linalg.norm(truth.L2_W[before]))
    displacement = lever * float(truth.theta[end] - truth.theta[before])
    lost = np.flatnonzero(~truth.touching[index : len(times)])
    touching = truth.touching[: len(times)]
    back = lasting_from(times, touching, KEPT, index + int(lost[0])) if len(lost) else None
    reestablished = float("nan") if back is None else float(times[back] - jerk.start)
    return {
        "start": jerk.start,
        "displacement": displacement,
        "contact_lost": len(lost) > 0,
        "reestablished_after": reestablished if len(lost) else 0.0,
    }


def summarise_recoveries(truth: TrueFlap, jerks: Sequence[FlapJerk]) -> dict[str, Any]:
    """What the jerks of an episode came to, for its summary; nothing where there were none."""
    found = [recovery(truth, jerk) for jerk in jerks]
    seen = [item for item in found if item is not None]
    if not jerks:
        return {}
    times = [item["reestablished_after"] for item in seen]
    back = len(seen) == len(jerks) and bool(np.isfinite(times).all())
    return {
        "contact_reestablished": back,
        "reestablished_after": max(times) if back else float("nan"),
        "jerks": seen,
    }
