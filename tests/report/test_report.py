"""The page as a whole: complete, self-contained and accessible, for every verdict."""

import copy
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from fabricated_diagnosis import HORIZON, document, evidence

from residual_mpc.report import Evidence, Panel, Windows, compose, write_report
from residual_mpc.report.figures import traces as figure
from residual_mpc.report.words.confidence import likelihood

VERDICTS = ("no_gap", "effects", "partial", "unknown")
VOID = {"meta", "br", "img", "link", "hr", "input", "col"}
OPTIONAL = (
    "where candidates confounded not_testable moved next_experiment schema stages_of_gap"
    " rivals remainder learned audit fit notes outliers seconds command"
).split()


class Page(HTMLParser):
    """Checks on the way that every element is closed in order, and gathers what the tests ask about."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(text)
        assert not self.open, f"never closed: {self.open}"

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open and self.open[-1] == tag, f"</{tag}> closes {self.open[-3:]}"
        self.open.pop()

    def handle_data(self, data):
        if not self.open or self.open[-1] != "style":
            self.text += " ".join(data.split()) + " "

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]


@pytest.fixture(scope="module", autouse=True)
def drawings():
    """The panels drawn so far: each is drawn once, since that takes most of a page's time."""
    drawn, draw = {}, figure.traces

    def traces(panel, name, start):
        signals = (x.tobytes() for x in (panel.t, panel.measured, panel.before, panel.after))
        key = (name, start, panel.run, panel.channel, panel.unit, *signals)
        if key not in drawn:
            drawn[key] = draw(panel, name, start)
        return drawn[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figure, "traces", traces)
        yield drawn


@pytest.fixture(scope="module", params=VERDICTS)
def page(request):
    return Page(compose(document(request.param), evidence(request.param)))


def test_page_is_whole_and_its_links_lead_somewhere(page):
    ids = [attributes["id"] for _, attributes in page.elements if attributes.get("id")]
    assert len(ids) == len(set(ids))
    for attributes in page.all("a") + page.all("use"):
        assert attributes["href"].removeprefix("#") in ids


def test_page_fetches_nothing_and_runs_nothing(page):
    assert not page.all("script") and not page.all("link") and not page.all("iframe")
    for _, attributes in page.elements:
        assert not any(name.startswith("on") for name in attributes)
        for value in attributes.values():
            assert "http:" not in (value or "") and "https:" not in (value or "")
    policy = next(a["content"] for a in page.all("meta") if a.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'")


@pytest.mark.parametrize("verdict", VERDICTS)
def test_text_names_no_host(verdict):
    text = compose(document(verdict), evidence(verdict))
    assert "://" not in text and "@import" not in text
    assert set(re.findall(r"url\((.)", text)) <= {"#"}


def test_page_is_accessible(page):
    assert page.all("html")[0]["lang"] == "en"
    assert page.all("title") and len(page.all("h1")) == 1 and page.all("main")
    assert all(attributes.get("aria-label") and attributes["role"] == "img" for attributes in page.all("svg"))
    assert all(attributes.get("alt") for attributes in page.all("img"))
    assert len(page.all("caption")) == len(page.all("table"))
    assert all(attributes.get("scope") in ("col", "row") for attributes in page.all("th"))


def test_same_diagnosis_gives_the_same_page(drawings):
    pages = []
    for _ in range(2):
        drawings.clear()
        pages.append(compose(document("effects"), evidence("effects")))
    assert pages[0] == pages[1]


@pytest.mark.parametrize("verdict", VERDICTS)
def test_a_document_with_the_least_in_it_is_shown(verdict):
    least = {key: value for key, value in document(verdict).items() if key not in OPTIONAL}
    least["gap"] = {key: least["gap"][key] for key in ("before", "after", "noise_floor", "horizon")}
    for effect in least["explanation"]:
        del effect["target"]
    Page(compose(least, Evidence()))


@pytest.mark.parametrize("key", OPTIONAL)
def test_an_optional_key_may_be_null(key):
    Page(compose(document("partial") | {key: None}, evidence("partial")))


def test_intervals_may_be_missing():
    some = copy.deepcopy(document("effects"))
    some["explanation"][0]["parameters"]["delay"]["ci95"] = None
    some["shrink"] |= {"expected": None, "expected_ci95": None}
    some["candidates"][0]["shrink"] = None
    assert "Expected and achieved" not in Page(compose(some, evidence("effects"))).text


def test_sections_follow_the_verdict():
    def titles(verdict):
        return re.findall(r"<h2[^>]*>([^<]*)</h2>", compose(document(verdict), evidence(verdict)))

    assert "Where the gap lies" not in titles("no_gap") and "Remaining error" not in titles("no_gap")
    assert "Effects that cannot be told apart" in titles("effects")
    for verdict in VERDICTS:
        assert titles(verdict)[0] == "Verdict" and titles(verdict)[-1] == "Definitions"


def test_what_a_user_named_is_escaped():
    named = document("partial") | {"robot": "<script>alert(1)</script>", "notes": ["<b>&"]}
    named["explanation"][0]["target"] = '"><img src=x>'
    panel = Panel("<i>", "a$b$<u>", "m<", *(np.linspace(0.0, 1.0, 9) for _ in range(4)))
    windows = Windows(["<i>"], np.zeros(1), np.ones(1), np.ones(1))
    page = Page(compose(named, Evidence((panel,), windows)))
    assert not page.all("script") and not page.all("img") and not page.all("u")
    assert "<script>alert(1)</script>" in page.text


def test_missed_promise_is_said():
    assert "less than the expected interval" in Page(compose(document("partial"), Evidence())).text
    assert "inside the expected interval" in Page(compose(document("effects"), Evidence())).text


def test_the_shown_sentence_is_the_one_in_the_document():
    page = Page(compose(document("effects") | {"verdict_sentence": "It is late."}, Evidence()))
    assert "It is late." in page.text


def test_write_report_leaves_one_file(tmp_path):
    path = write_report(document("effects"), evidence("effects"), tmp_path / "new" / "out")
    assert path == tmp_path / "new" / "out" / "report.html"
    assert [child.name for child in path.parent.iterdir()] == ["report.html"]
    assert path.read_text(encoding="utf-8").startswith("<!doctype html>")


def test_a_broken_document_leaves_nothing(tmp_path):
    with pytest.raises(KeyError):
        write_report({"robot": "rover"}, Evidence(), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_many_runs_and_long_signals_stay_small():
    rng = np.random.default_rng(1)
    count = 400
    windows = Windows(
        [f"run{k // 60}" for k in range(count * 60)],
        HORIZON * np.tile(np.arange(60.0), count),
        rng.uniform(0.0, 1.0, count * 60),
        rng.uniform(0.0, 0.1, count * 60),
    )
    t = np.arange(0.0, 60.0, 0.002)
    noise = rng.standard_normal((3, t.size))  # nothing to simplify: the worst case for a drawing of lines
    page = compose(document("effects"), Evidence((Panel("run1", "pose.x", "m", t, *noise),), windows))
    assert len(page.encode()) < 1_500_000
    assert "376 more runs" in Page(page).text


def test_the_next_experiment_says_what_to_log_and_what_plans_its_commands():
    said = Page(compose(document("unknown"), evidence("unknown"))).text
    assert "Also log velocity.left , velocity.right ." in said
    assert "residual-mpc excite out/diagnosis.json --robot arm.toml --out out/next.csv" in said


def test_what_the_learned_residual_closes_says_who_learned():
    assert "Removed by a neural network on top" in Page(compose(document("partial"), evidence("partial"))).text


@pytest.mark.parametrize(
    ("verdict", "badge"),
    [("effects", "Explained"), ("partial", "Partly explained"), ("unknown", "Unknown"), ("no_gap", "No gap")],
)
def test_the_badge_says_the_verdict(verdict, badge):
    assert f'<span class="badge {verdict}">{badge}</span>' in compose(document(verdict), evidence(verdict))


def test_every_horizon_has_a_row_and_one_that_the_fit_has_seen_is_marked():
    text = " ".join(Page(compose(document("effects"), evidence("effects"))).text.split())
    assert "By horizon" in text and "30 s * 0.09 0.031 0.02" in text
    assert "* At 30 s no whole window could be held out" in text and "Channels over 5 s" in text
    assert "By horizon" not in Page(compose(document("partial"), evidence("partial"))).text  # an older document


def test_the_forecast_of_constant_velocity_is_a_line_and_a_warning():
    page = compose(document("partial"), evidence("partial"))
    mark = r'style="--at:42.2%"><i></i><span>constant velocity: 38.%<'
    assert re.search(mark, page)
    assert "The nominal and the final model predict worse" in Page(page).text
    without = document("partial")
    del without["gap"]["constant_velocity"]
    assert "constant velocity" not in compose(without, evidence("partial"))


def test_an_effect_in_doubt_is_a_possibility_and_says_what_supports_it():
    text = Page(compose(document("partial"), evidence("partial"))).text
    assert "Possibly actuator wrist delivers" in text and "Begins 31 s into run1." in text
    assert "Is found whichever run" not in text
    named = Page(compose(document("effects"), evidence("effects"))).text
    assert "Fits significantly better, predicts held-out runs better and is found whichever run is left out." in named
    assert "At the bound of its search range." in named


EPOCH = 1_760_000_000.0  # s


def test_times_count_from_the_start_of_each_run():
    ours, shown = document("partial"), evidence("partial")
    late = Evidence(
        tuple(replace(p, t=p.t + EPOCH) for p in shown.panels),
        replace(shown.windows, start=shown.windows.start + EPOCH),
        dict.fromkeys(("run1", "run2", "run3"), EPOCH),
    )
    for part in [*ours["held_out"], *ours["where"]["times"]]:
        part |= {"from": part["from"] + EPOCH, "to": part["to"] + EPOCH}
    ours["explanation"][2]["since"]["t"] += EPOCH
    page = compose(ours, late)
    assert "1760" not in page and "10⁹" not in page
    text = Page(page).text
    assert "12 to 15.98 s" in text and "from 0.5 to 20.5 s" in text and "Begins 31.5 s into run1." in text


def test_the_first_screen_has_the_gap_before_and_after_as_one_bar():
    page = Page(compose(document("partial"), evidence("partial")))
    (bar,) = (a for tag, a in page.elements if tag == "div" and a.get("class") == "gap-bar")
    said = bar["aria-label"]
    said = said.replace("\N{NO-BREAK SPACE}", " ")
    assert said.startswith("Nominal model: 90 %; Nominal model, retuned: 66 %; With the named effects: 41 %; a tenth")
    assert "noise floor: 2 %" in said and "constant velocity: 38 %" in said
    widths = [a["style"] for tag, a in page.elements if tag == "i" and a.get("class") in ("nominal", "before", "after")]
    assert widths == ["width:100.0%", "width:73.3%", "width:45.6%"]


def test_a_forecast_off_the_scale_is_said():
    far = document("effects")
    far["gap"]["constant_velocity"] = 3.0
    assert "Off this scale: constant velocity: 300" in Page(compose(far, Evidence())).text


def test_the_first_screen_has_at_most_three_numbers_to_change_the_surest_first():
    page = compose(document("partial"), evidence("partial"))
    first = page[page.index('<section id="verdict"') : page.index('<section id="causes"')]
    names = re.findall(r"<dt>([^<]*)</dt>", first)
    assert names == ["Coulomb friction of elbow", "Backlash of shoulder_lift", "Sensor bias of position.elbow"]
    assert "very likely (93 %)" in first.replace("\N{NO-BREAK SPACE}", " ") and "1 more number under" in first
    assert "What to change" not in compose(document("no_gap"), evidence("no_gap"))


@pytest.mark.parametrize(
    ("probability", "word"),
    [(1.0, "virtually certain"), (0.9, "very likely"), (0.89, "likely"), (0.5, "about as likely as not")],
)
def test_confidence_is_in_the_words_of_the_ipcc(probability, word):
    assert likelihood(probability) == word
