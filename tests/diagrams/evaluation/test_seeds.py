import pytest

from crossmodal.diagrams.evaluation.seeds import parse_seeds
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("100:103", [100, 101, 102]),
        ("2", [0, 1]),
        ("7:8", [7]),
        ("1,4,9", [1, 4, 9]),
        ("3:5,4,8", [3, 4, 8]),
    ],
)
def test_seeds_are_counts_ranges_and_lists(text: str, expected: list[int]) -> None:
    assert parse_seeds(text) == expected


@pytest.mark.parametrize("text", ["", "0", "a", "1:", "5:5", "-3", "1;2", "1,,2", "²"])
def test_other_seeds_are_refused(text: str) -> None:
    with pytest.raises(ScenarioError, match="--seeds"):
        parse_seeds(text)


@pytest.mark.parametrize(
    ("text", "cause", "other"),
    [
        ("5:2", "names no seed", "negative"),
        ("0:0", "names no seed", "negative"),
        ("0", "names no seed", "negative"),
        ("-2:1", "negative", "names no seed"),
        ("5:2,-1", "negative", "names no seed"),
    ],
)
def test_the_one_cause_is_told(text: str, cause: str, other: str) -> None:
    with pytest.raises(ScenarioError, match=f"--seeds {text}: .*{cause}") as told:
        parse_seeds(text)
    assert other not in str(told.value)
