"""The page of one run begins with a picture and explains its words."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from chromium import opened_page
from matplotlib.figure import Figure
from synthetic_episode import empty_episode, synthetic_episode
from toy_application import TOY, toy_summary

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.crossmodal.application import APPLICATION
from crossmodal.diagrams.evaluation.run_report import figures_tables, portrait_of, run_page
from crossmodal.diagrams.evaluation.run_writer import write_run
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.diagrams.run.scenario import Scenario

RUN = {"interrupted": False, "events": [{"time": 1.25, "name": "looking"}]}


def toy_page(files: tuple[str, ...] = (), **summary: Any) -> str:
    whole = toy_summary(3, left=0.002, right=None) | RUN | summary
    scenario = Scenario(name="near", description="something near", seed=3)
    return run_page(TOY, scenario, whole, ["NEES of the left eye"], files)


def page_of(record: EpisodeRecord, folder: Path) -> str:
    record.scenario = load_scenario("drawer", ["seed=3"])[1]
    pictures = dict.fromkeys(("errors.png", "frames.png"), Figure)
    results = replace(APPLICATION.evaluate(record), plots=pictures)
    write_run(folder, APPLICATION, record, results)
    return (folder / "report.html").read_text()


def test_it_begins_with_outcome_and_picture_and_says_what_was_done(tmp_path: Path) -> None:
    page = page_of(synthetic_episode(), tmp_path)
    order = ["drawer, seed 3", "The task was done.", 'src="figures/frames.png"',
             "Scenario: a robot pulls an unknown drawer open.", "20 cm", "The columns",
             "<summary>What the words mean", "<td>joint found</td>", "What was printed",
             'src="figures/errors.png"', 'href="summary.json"']  # fmt: skip
    places = [page.index(text) for text in order]
    assert places == sorted(places)
    assert page.count('src="figures/frames.png"') == 1
    assert 'alt="frames: a robot pulls an unknown drawer open"' in page
    assert "at the turning point" not in page  # This robot does not bring the drawer back.
    assert "above" in page[page.index("<dt>NEES</dt>") :].lower()


def test_a_run_without_anything_perceived_has_a_page_too(tmp_path: Path) -> None:
    record = empty_episode()
    record.interrupted = True
    page = page_of(record, tmp_path)
    assert "Stopped by hand after 0.0 s" in page
    assert 'class="mixed"' in page
    assert "joint type right" not in page  # Nothing is known of the true one.


@pytest.mark.parametrize(
    ("summary", "text", "tone"),
    [
        ({"success": False, "failure": "it <slipped>"}, "not done: it &lt;slipped&gt;.", "bad"),
        ({"success": None}, "It is not known whether the task was done.", ""),
        ({"success": True}, "The task was done.", "good"),
    ],
)
def test_the_outcome_has_its_colour(summary: dict[str, Any], text: str, tone: str) -> None:
    begin = f'<p class="{tone}"><b>' if tone else "<p><b>"
    page = toy_page(**summary)
    assert text in page
    assert begin in page


def test_an_application_without_pictures_and_glossary_has_the_common_words() -> None:
    page = toy_page()
    assert "<img" not in page
    assert "<dt>NEES</dt>" in page
    assert "Normalised estimation error squared" in page
    assert "<dt>RMS</dt>" not in page


def test_figures_are_magnitudes_with_units_and_what_is_true_has_a_colour() -> None:
    whole, estimators = figures_tables(TOY, "near", toy_summary(3, left=-0.002, right=None))
    assert whole.rows == [["scored", "yes"]]
    assert whole.tone(0, 1) == "good"
    assert estimators.header == ["", "right", "the left eye"]
    assert estimators.rows == [["error of the distance", "-", "2 mm"]]
    assert len(figures_tables(TOY, "far", toy_summary(3, left=0.002, right=None))) == 1


def test_the_portrait_is_the_applications_choice_or_the_first_picture() -> None:
    pictures = ["figures/a.png", "figures/frames.png"]
    assert portrait_of(APPLICATION, pictures) == "figures/frames.png"
    assert portrait_of(TOY, pictures) == "figures/a.png"
    assert portrait_of(TOY, []) == ""


def test_events_and_files_are_there_for_who_looks_for_more() -> None:
    page = toy_page(files=("summary.json", "video.mp4"))
    assert "<summary>events, in order of time (1)</summary>" in page
    assert "<td>1.2 s</td><td>looking</td>" in page
    assert page.count("<li>") == 1


@pytest.mark.parametrize("dark", [False, True])
def test_on_a_phone_nothing_is_wider_than_the_screen(tmp_path: Path, dark: bool) -> None:
    page_of(synthetic_episode(), tmp_path)
    address = (tmp_path / "report.html").as_uri()
    with opened_page(address, width=390, dark=dark) as page:
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        color = page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert (color == "rgb(255, 255, 255)") != dark
