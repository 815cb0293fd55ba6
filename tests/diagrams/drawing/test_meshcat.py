import pytest

from crossmodal.diagrams.drawing.meshcat import start_meshcat


def test_the_server_is_for_this_machine_only() -> None:
    assert "localhost" in start_meshcat().web_url()


def test_an_interface_that_there_is_not_is_refused() -> None:
    with pytest.raises(RuntimeError, match="this machine has no such address"):
        start_meshcat("203.0.113.7")


def test_a_name_that_nobody_has_is_refused_at_once() -> None:
    with pytest.raises(RuntimeError, match="the name is not known"):
        start_meshcat("nope.invalid")
