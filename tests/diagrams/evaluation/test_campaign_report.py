import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure
from synthetic_episode import synthetic_episode

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.evaluation.campaign import Campaign, episode_folder, prepare
from crossmodal.diagrams.evaluation.campaign_report import made_by, write_campaign, write_overview
from crossmodal.diagrams.evaluation.run_writer import write_run
from crossmodal.diagrams.run.folder.run_folder import finished_summary


def finished_campaign(folder: Path, name: str = "drawer", *, plots: bool = True) -> Campaign:
    """Two episodes that have ended and one that broke off; empty pictures of each."""
    application, scenario = load_scenario(name)
    if not plots:
        application = replace(application, campaign_plots={})
    campaign = prepare(name, application, scenario, [1, 2, 3], folder)
    for one in campaign.scenarios[:2]:
        record = synthetic_episode(seed=one.seed)
        record.scenario = one
        place = episode_folder(folder, one.seed)
        pictures = dict.fromkeys(("errors.png", "frames.png"), Figure)
        results = replace(application.evaluate(record), plots=pictures)
        write_run(place, application, record, results)
        summary = finished_summary(place, application, one)
        assert summary is not None
        campaign.summaries.append(summary)
    campaign.summaries.append(broken(3))
    return campaign


def broken(seed: int) -> dict[str, Any]:
    return {"scenario": "drawer", "seed": seed, "success": False, "failure": "no <way>",
            "modalities": {}, "phases": {}}  # fmt: skip


def test_the_page_holds_every_picture_and_every_reason(tmp_path: Path) -> None:
    campaign = finished_campaign(tmp_path)
    written = write_campaign(campaign, "`crossmodal evaluate drawer`")
    assert {path.name for path in written} == {
        "results.csv", "table.md", "errors_over_time.png", "errors_at_end.png", "report.html",
    }  # fmt: skip
    page = (tmp_path / "report.html").read_text()
    sources = re.findall(r'src="([^"]*)"', page)
    assert len(sources) == 5
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert "no &lt;way&gt;" in page
    for link in re.findall(r'href="([^"]*)"', page):
        assert (tmp_path / link).is_file()
    assert set(pd.read_csv(tmp_path / "results.csv").seed) == {1, 2, 3}


def test_nothing_is_written_before_an_episode_has_ended(tmp_path: Path) -> None:
    campaign = prepare("drawer", *load_scenario("drawer"), [1], tmp_path)
    assert write_campaign(campaign, "") == []
    assert write_overview([campaign], tmp_path, "") == []


def test_the_overview_holds_all_experiments(tmp_path: Path) -> None:
    campaigns = [
        finished_campaign(tmp_path / name, name) for name in ("drawer", "drawer-lights-off")
    ]
    for campaign in campaigns:
        write_campaign(campaign, "")
    write_overview(campaigns, tmp_path, "made so")
    table = (tmp_path / "table.md").read_text()
    assert "| all | 4/6 |" in table
    assert "## drawer-lights-off: 3 episodes, seeds 1 to 3" in table
    assert set(pd.read_csv(tmp_path / "results.csv").experiment) == {"drawer", "drawer-lights-off"}
    page = (tmp_path / "report.html").read_text()
    assert page.count("<h2") == 2
    for link in re.findall(r'href="([^"]*)"', page):
        assert (tmp_path / link).is_file()


def test_damaged_files_of_an_evaluation_are_written_anew(tmp_path: Path) -> None:
    campaign = finished_campaign(tmp_path)
    written = {path: path.read_bytes() for path in write_campaign(campaign, "")}
    for path in written:
        path.write_bytes(b"damaged")
    (tmp_path / "results.csv").unlink()
    write_campaign(campaign, "")
    assert all(path.read_bytes() == content for path, content in written.items())


def test_an_interrupted_evaluation_says_so_beside_every_count(tmp_path: Path) -> None:
    campaigns = [finished_campaign(tmp_path / "drawer")]
    campaigns.append(prepare("drawer-lights-off", *load_scenario("drawer-lights-off"), [1, 2, 3],
                             tmp_path / "dark"))  # fmt: skip
    del campaigns[0].summaries[2]
    origin = made_by("crossmodal evaluate all --seeds 1:4", complete=False)
    write_campaign(campaigns[0], origin)
    write_overview(campaigns, tmp_path, origin)
    for file in ("table.md", "report.html"):
        own = (tmp_path / "drawer" / file).read_text()
        assert "drawer: 2 of 3, interrupted: seeds 1, 2 of 1 to 3" in own
        assert own.count("2 of 3, interrupted") == (4 if file == "report.html" else 3)
        together = (tmp_path / file).read_text()
        assert "all: 2 of 6, interrupted" in together
        assert "drawer-lights-off: 0 of 3, interrupted" in together
        assert " %)" not in together.split("drawer: 2 of 3, interrupted: seeds")[0]
        for text in (own, together):
            assert re.search(r"--seeds 1:4`?, interrupted, crossmodal", text)


def test_a_card_links_all_pictures_of_its_episode(tmp_path: Path) -> None:
    campaign = finished_campaign(tmp_path, plots=False)
    figures = episode_folder(tmp_path, 1) / "figures"
    names = sorted(path.name for path in figures.glob("*.png"))
    assert len(names) > 1
    (figures / "no_picture_of_it.png").write_bytes((figures / names[0]).read_bytes())
    write_campaign(campaign, "")
    page = (tmp_path / "report.html").read_text()
    assert "no_picture_of_it" not in page
    for name in names:
        shown = name.removesuffix(".png").replace("_", " ")
        assert f'<a href="seed-0001/figures/{name}">{shown}</a>' in page


def test_the_page_says_what_counts_as_done(tmp_path: Path) -> None:
    campaign = finished_campaign(tmp_path, plots=False)
    write_campaign(campaign, "")
    words = campaign.application.task_in_words(campaign.scenarios[0])
    assert "20 cm" in words
    for file in ("report.html", "table.md"):
        assert words in (tmp_path / file).read_text()
