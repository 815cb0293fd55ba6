"""The page of a finished run: what it shows of any folder, and what it never serves."""

import json
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from chromium import opened_page
from PIL import Image
from pydrake.geometry import Box, Meshcat, MeshcatParams, Rgba
from pydrake.math import RigidTransform

from crossmodal.diagrams.applications import find_application
from crossmodal.diagrams.drawing.plot_style import TIME, new_figure, save
from crossmodal.diagrams.evaluation.finished_run.read_run import (
    FinishedRun,
    read_finished_run,
    values_over_time,
)
from crossmodal.diagrams.evaluation.finished_run.server import RunServer
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError

LAST = 2.0  # End of the episode, [s].


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A run of two estimators, of which one knows nothing at first."""
    run = tmp_path / "run"
    (run / "figures").mkdir(parents=True)
    (run / "scenario.yaml").write_text("system: crossmodal\nname: <b>door</b>\nseed: 7\n")
    summary = {"seed": 7, "success": False, "failure": "it slipped",
               "events": [{"time": 0.5, "name": "moving"}]}  # fmt: skip
    (run / "summary.json").write_text(json.dumps(summary))
    times = np.arange(0.0, LAST + 0.01, 0.1)
    rows = [
        (time, name, "configuration", "", 0.1 * time, 0.01, [1e-4], 0.1 * time + 0.003)
        for name in ("vision", "crossmodal")
        for time in times
        if name == "vision" or time > 1.0
    ]
    columns = ["time", "modality", "quantity", "component", "estimate", "std", "covariance",
               "truth"]  # fmt: skip
    pd.DataFrame(rows, columns=columns).to_parquet(run / "estimates.parquet")
    figure = new_figure(4.0, 3.0)
    axes = figure.subplots()
    axes.plot([0.0, LAST], [0.0, 1.0])
    axes.set_xlim(0.0, LAST)
    axes.set_xlabel(TIME)
    save(figure, run / "figures" / "errors.png")
    return run


def read(folder: Path) -> FinishedRun:
    return read_finished_run(folder, find_application)


@contextmanager
def served(folder: Path) -> Iterator[RunServer]:
    with RunServer(read(folder)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server
        server.shutdown()


def fetch(server: RunServer, path: str, host: str = "localhost") -> tuple[int, bytes]:
    request = urllib.request.Request(f"{server.url}{path}", headers={"Host": host})
    try:
        with urllib.request.urlopen(request) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, b""


def test_all_of_a_whole_run_is_read(folder: Path) -> None:
    (folder / "meshcat.html").write_text("<html></html>")
    run = read(folder)
    assert (run.missing, run.seed, run.success) == ([], "7", False)
    assert run.outcome == "not done: it slipped"
    assert run.events == [(0.5, "moving")]
    assert run.estimators == ["vision", "crossmodal"]
    ((left, right, top, bottom, first, last),) = run.pictures["figures/errors.png"]
    assert 0.0 < left < right < 1.0
    assert 0.0 <= top < bottom < 1.0
    assert (first, last) == (0.0, LAST)


def test_values_stand_at_common_times_and_what_is_not_known_is_none(folder: Path) -> None:
    values = values_over_time(read(folder))
    (row,) = values["rows"]
    assert len(values["times"]) == len(row["truth"]) == 21
    assert row["series"]["crossmodal"]["estimate"][3] is None
    assert row["series"]["crossmodal"]["estimate"][15] == pytest.approx(0.15)
    assert row["truth"][15] == pytest.approx(0.153)


def test_estimators_whose_frames_differ_have_rows_and_truths_of_their_own(folder: Path) -> None:
    file = folder / "estimates.parquet"
    table = pd.read_parquet(file)
    table.loc[table["modality"] == "crossmodal", "truth"] += 0.05
    table.to_parquet(file)
    of_vision, of_both = values_over_time(read(folder))["rows"]
    assert (list(of_vision["series"]), list(of_both["series"])) == (["vision"], ["crossmodal"])
    assert of_both["truth"][15] - of_vision["truth"][15] == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("file", "content", "expected"),
    [
        ("estimates.parquet", b"PAR1 no table", "estimates.parquet cannot be read"),
        ("estimates.parquet", None, "there is no estimates.parquet"),
        ("summary.json", b"{", "summary.json is not there or is damaged"),
        ("summary.json", None, "summary.json is not there or is damaged"),
        ("scenario.yaml", b"system: other\n", "scenario.yaml: system = 'other'"),
        ("scenario.yaml", b"a: [", "is not valid YAML"),
        ("figures/errors.png", b"\x89PNG\r\n\x1a\n", "errors.png is not shown: it is damaged"),
    ],
)
def test_what_cannot_be_shown_is_said_in_a_line_and_the_rest_is_shown(
    folder: Path, file: str, content: bytes | None, expected: str
) -> None:
    (folder / "meshcat.html").write_text("<html></html>")
    if content is None:
        (folder / file).unlink()
    else:
        (folder / file).write_bytes(content)
    (line,) = read(folder).missing
    assert expected in line
    assert "\n" not in line
    with served(folder) as server:
        status, page = fetch(server, "")
        assert status == 200
        assert b'class="warning"' in page


def test_a_table_of_another_version_is_shown_as_far_as_it_goes(folder: Path) -> None:
    table = pd.read_parquet(folder / "estimates.parquet")
    table.drop(columns=["truth", "covariance"]).to_parquet(folder / "estimates.parquet")
    (row,) = values_over_time(read(folder))["rows"]
    assert set(row["truth"]) == {None}
    table.drop(columns="modality").to_parquet(folder / "estimates.parquet")
    assert "it has no column modality" in read(folder).missing[-1]


def test_a_plot_without_marks_has_no_cursor_and_a_line_says_so(folder: Path) -> None:
    Image.new("RGB", (8, 6)).save(folder / "figures" / "old.png")
    run = read(folder)
    assert run.pictures["figures/old.png"] == []
    assert any("No cursor is shown in old.png" in line for line in run.missing)


def test_where_there_is_nothing_to_show_it_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="holds nothing of a run"):
        read(tmp_path)


def test_a_folder_of_runs_names_one_of_them_and_its_page(folder: Path) -> None:
    above = folder.parent
    with pytest.raises(ScenarioError, match=r"holds 1 runs; show one .* crossmodal show .*/run$"):
        read(above)
    evaluation = above / "evaluation"
    evaluation.mkdir()
    folder.rename(evaluation / "seed-0003")
    (evaluation / "report.html").write_text("")
    with pytest.raises(ScenarioError, match=r"seed-0003; open .*/report.html in a browser"):
        read(evaluation)
    with pytest.raises(ScenarioError, match=r"crossmodal show .*/evaluation/seed-0003$"):
        read(above)


def test_nothing_but_what_is_shown_is_served(folder: Path) -> None:
    (folder.parent / "secret.txt").write_text("secret")
    (folder / "notes.txt").write_text("private")
    with served(folder) as server:
        for path in ("", "show.js", "estimates.json", "figures/errors.png", "plots/configuration"):
            assert fetch(server, path)[0] == 200
        for path in (
            "scenario.yaml", "notes.txt", "figures/../notes.txt", "../secret.txt",
            "%2e%2e/secret.txt", "figures/%2e%2e/%2e%2e/secret.txt", "scene.html", "/etc/passwd",
            "plots/none", "figures/", "server.py",
        ):  # fmt: skip
            assert fetch(server, path)[0] == 404, path


def test_a_page_from_elsewhere_cannot_call_this_machine_by_another_name(folder: Path) -> None:
    with served(folder) as server:
        assert server.server_address[0] == "127.0.0.1"
        assert fetch(server, "", host="attacker.example")[0] == 404


def test_no_link_is_followed_out_of_the_folder(folder: Path) -> None:
    outside = folder.parent / "outside"
    outside.mkdir()
    for file in ("estimates.parquet", "summary.json", "scenario.yaml", "figures/errors.png"):
        moved = outside / Path(file).name
        (folder / file).rename(moved)
        (folder / file).symlink_to(moved)
    (outside / "meshcat.html").write_text("secret")
    (folder / "meshcat.html").symlink_to(outside / "meshcat.html")
    with pytest.raises(ScenarioError, match="holds nothing of a run"):
        read(folder)


def test_a_link_that_was_put_there_later_is_not_followed_either(folder: Path) -> None:
    (folder / "meshcat.html").write_text("<html></html>")
    (folder.parent / "secret.txt").write_text("secret")
    with served(folder) as server:
        for file, path in (("meshcat.html", "scene.html"), ("figures/errors.png",) * 2):
            assert fetch(server, path)[0] == 200
            (folder / file).unlink()
            (folder / file).symlink_to(folder.parent / "secret.txt")
            assert fetch(server, path)[0] == 404


def test_text_of_the_files_is_no_html_of_the_page(folder: Path) -> None:
    with served(folder) as server:
        page = fetch(server, "")[1].decode()
    assert "<b>door</b>" not in page
    assert "&lt;b&gt;door" in page


def write_scene(folder: Path) -> None:
    """A recording of a box that moves by 1 m/s along x."""
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    meshcat.SetObject("box", Box(0.2, 0.2, 0.2), Rgba(0.8, 0.2, 0.1))
    meshcat.StartRecording()
    for time in np.arange(0.0, LAST + 0.01, 0.1):
        meshcat.SetTransform("box", RigidTransform([time, 0.0, 0.0]), time)
    meshcat.PublishRecording()
    (folder / "meshcat.html").write_text(meshcat.StaticHtml())


def test_one_slider_moves_scene_values_and_cursor_in_a_browser(folder: Path) -> None:
    write_scene(folder)
    with served(folder) as server, opened_page(server.url) as page:
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.wait_for_selector("#scene[data-ready]")
        page.wait_for_selector("#values tbody tr")
        frame = next(frame for frame in page.frames if frame.url.endswith("scene.html"))
        place = "viewer.scene_tree.find(['drake', 'box']).object.position.x"

        def move(time: float) -> tuple[float, str, float]:
            page.evaluate(
                "time => { const slider = document.getElementById('time'); slider.value = time;"
                " slider.dispatchEvent(new Event('input')); }",
                time,
            )
            page.wait_for_function(
                "time => document.getElementById('now').textContent === time", arg=f"{time:.2f} s"
            )
            frame.wait_for_function(f"Math.abs({place} - {time}) < 0.02")
            cursor = page.locator(".cursor").evaluate("one => parseFloat(one.style.left)")
            return frame.evaluate(place), page.locator("#values tbody").inner_text(), cursor

        (early, values, left), (late, later_values, right) = move(0.5), move(1.5)
        assert late - early == pytest.approx(1.0, abs=0.05)
        assert right > left
        assert "0.050 ± 0.010" in values
        assert "0.150 ± 0.010" in later_values
        page.locator("button[data-time]").click()
        assert page.locator("#now").inner_text() == "0.50 s"
        page.locator("#play").click()
        page.wait_for_function("() => document.getElementById('now').textContent > '0.50 s'")
        assert all(url.startswith((server.url, "data:", "blob:")) for url in asked)
