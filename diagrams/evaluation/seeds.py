"""Which seeds an experiment is repeated over."""

from diagrams.run.yaml_schema import ScenarioError


def parse_seeds(text: str) -> list[int]:
    """Seeds: so many from 0 on ('20'), a range without its end ('40:60') or a list ('1,4,9').

    A count takes seeds that anybody may look at; docs/results/seeds.md says which others were run.

    Raises:
        ScenarioError: where it names no seed, or a negative one.
    """
    try:
        if text.strip().isdigit():
            seeds = list(range(int(text)))
        else:
            seeds = [seed for part in text.split(",") for seed in _part(part)]
    except ValueError:
        raise ScenarioError(
            f"--seeds {text}: expected a count such as 20, a range such as 40:60"
            " or a list such as 3,5,8"
        ) from None
    if not seeds or min(seeds) < 0:
        raise ScenarioError(f"--seeds {text}: names no seed, or a negative one")
    return list(dict.fromkeys(seeds))


def _part(text: str) -> range:
    first, colon, last = text.strip().partition(":")
    return range(int(first), int(last) if colon else int(first) + 1)
