"""Which seeds an experiment is repeated over."""

from crossmodal.diagrams.run.yaml_input.schema import ScenarioError


def parse_seeds(text: str) -> list[int]:
    """Seeds: so many from 0 on ('20'), a range without its end ('40:60') or a list ('1,4,9').

    A count takes seeds that anybody may look at; docs/results/seeds.md says which others were run.

    Raises:
        ScenarioError: where it names no seed, or a negative one.
    """
    try:
        count = text.strip()
        parts = [range(int(count))] if count.isdecimal() else list(map(_part, text.split(",")))
    except ValueError:
        raise ScenarioError(
            f"--seeds {text}: expected a count such as 20, a range such as 40:60"
            " or a list such as 3,5,8"
        ) from None
    if any(part and part[0] < 0 for part in parts):
        raise ScenarioError(f"--seeds {text}: a seed is negative; they begin at 0")
    if not any(parts):
        raise ScenarioError(
            f"--seeds {text}: names no seed; a count is at least 1, and a range such as 40:60 ends"
            " above its start, without its end"
        )
    return list(dict.fromkeys(seed for part in parts for seed in part))


def _part(text: str) -> range:
    first, colon, last = text.strip().partition(":")
    return range(int(first), int(last) if colon else int(first) + 1)
