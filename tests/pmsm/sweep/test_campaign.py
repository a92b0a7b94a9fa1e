"""What a study file says of a campaign: files, groups, dates, horizons, seeds, variants."""

import pytest

from penode.errors import InputError
from penode.pmsm.sweep.campaign import load_campaign


@pytest.fixture
def declared(tmp_path):
    """Return a function from the text of a study file to its campaign, beside four recordings."""
    for name in ("a_2026-01-31.csv", "b_20260201.csv", "c.csv", "notes.txt"):
        (tmp_path / "logs").mkdir(exist_ok=True)
        (tmp_path / "logs" / name).write_text(f"t,u_d\n{name}\n")

    def load(text, runs=(), **asked):
        path = tmp_path / "study.toml"
        path.write_text(text)
        return load_campaign(path, runs, {}, asked)

    return load


FILES = '[sweep]\nrecordings = ["logs/*.csv"]\n'


def test_each_file_is_identified_by_itself_in_order(declared):
    campaign = declared(FILES)
    names = ["logs/a_2026-01-31.csv", "logs/b_20260201.csv", "logs/c.csv"]
    assert [one.name for one in campaign.recordings] == names
    assert [row.labels["recording"] for row in campaign.planned()] == names
    assert len(campaign) == 3


def test_files_in_brackets_of_their_own_belong_together(declared):
    campaign = declared('[sweep]\nrecordings = [["logs/a*.csv", "logs/c.csv"]]\n')
    (one,) = campaign.recordings
    assert one.name == "logs/a_2026-01-31.csv + logs/c.csv"
    (planned,) = campaign.planned()
    assert len(planned.task.files) == len(planned.task.digests) == 2


def test_machine_and_date_come_from_the_name(declared):
    campaign = declared(FILES + r"name = '(?P<machine>[a-z])_(?P<date>\d{4}-?\d\d-?\d\d)'")
    said = [(one.machine, one.date) for one in campaign.recordings]
    assert said == [("a", "2026-01-31"), ("b", "2026-02-01"), (None, None)]


def test_every_variant_at_every_horizon_from_every_seed(declared):
    text = FILES + 'horizons = [5, "auto"]\nseeds = 2\n[sweep.variants.plain]\n'
    campaign = declared(text + '[sweep.variants.network]\nflux_map = "mlp"\n')
    rows = list(campaign.planned())
    assert len(rows) == len(campaign) == 3 * 2 * 2 * 2
    labels = [(row.labels["variant"], row.labels["horizon"], row.labels["seed"]) for row in rows]
    assert labels[:4] == [("plain", 5, 0), ("plain", 5, 1), ("plain", None, 0), ("plain", None, 1)]
    studies = {row.labels["variant"]: row.task.asked.study for row in rows}
    assert {name: study.flux_map for name, study in studies.items()} == {
        "plain": "coenergy",
        "network": "mlp",
    }
    assert [row.labels for row in rows] == list(campaign.labels())
    assert len({row.task.key for row in rows}) == len(rows)


def test_a_variant_keeps_its_own_horizon_and_seed(declared):
    campaign = declared(
        "seed = 4\n" + FILES + "[sweep.variants.short]\nhorizon = 3\n[sweep.variants.rest]\n"
    )
    labels = [(one["variant"], one["horizon"], one["seed"]) for one in campaign.labels()][:2]
    assert labels == [("short", 3, 4), ("rest", None, 4)]


def test_recordings_on_the_command_line_replace_those_of_the_file(declared, tmp_path):
    campaign = declared(FILES, (tmp_path / "logs" / "c.csv",))
    assert [one.files for one in campaign.recordings] == [(tmp_path / "logs" / "c.csv",)]


def test_a_key_is_the_content_of_data_settings_and_code(declared, tmp_path, monkeypatch):
    def key(text=""):
        return next(declared(text + FILES + "horizons = [1]").planned()).task.key

    first = key()
    assert key() == first
    assert key('hold = "dq"\n') != first
    (tmp_path / "logs").rename(tmp_path / "moved")
    moved = '[sweep]\nrecordings = ["moved/*.csv"]\nhorizons = [1]'
    assert next(declared(moved).planned()).task.key == first
    (tmp_path / "moved").rename(tmp_path / "logs")
    monkeypatch.setattr("penode.pmsm.sweep.campaign.code_version", lambda: "another")
    assert key() != first
    monkeypatch.undo()
    (tmp_path / "logs" / "a_2026-01-31.csv").write_text("t,u_d\n1\n")
    assert key() != first


def test_a_file_that_is_not_there_is_a_row_with_its_sentence(declared):
    planned = list(declared('[sweep]\nrecordings = ["logs/c.csv", "logs/no.csv"]').planned())
    assert [row.task is None for row in planned] == [False, True]
    assert "no.csv: the file cannot be read" in planned[1].error


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no recordings; name some"),
        ("[sweep]\nrecordings = []", "recordings = [] came"),
        ("[sweep]\nrecordings = [3]", "recordings = [3] came"),
        ('[sweep]\nrecordings = ["logs/*.mat"]', "no file matches 'logs/*.mat'"),
        ('[sweep]\nrecordings = ["/logs/*.mat"]', "give a pattern within the folder"),
        (FILES + "horizons = [0]", "horizons [0] came"),
        (FILES + "horizons = [2, 2]", "horizons [2, 2] came"),
        (FILES + 'horizons = ["far"]', "horizons = ['far'] came"),
        (FILES + "seeds = 0", "seeds = 0 came"),
        (FILES + "seeds = 1000000000", "1000000000 seeds came"),
        (FILES + "seed = 1", "sweep: seed came (did you mean seeds?)"),
        (FILES + "current = [1]", "current = [1] came"),
        (FILES + "name = '('", "give a regular expression"),
        (FILES + "name = '(?P<bench>a)'", "name its groups machine and date"),
        (FILES + r"name = '(?P<date>\d{4})'", "the date '2026' came of its name"),
        (FILES + "variants = 3", "variants = 3 came"),
        (FILES + "[sweep.variants]\na = 3", "variant a = 3 came"),
        (FILES + "[sweep.variants.a]\nflux_map = 'no'", "flux_map must be one of"),
        (FILES + "horizons = [1]\n[sweep.variants.a]\nhorizon = 2", "variant a has horizon"),
    ],
)
def test_what_cannot_be_is_one_sentence(declared, text, words):
    with pytest.raises(InputError) as refusal:
        declared(text)
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)
