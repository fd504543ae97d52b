"""The page and the lines of a comparison: complete, self-contained and accessible, for every verdict."""

import copy
import re

import pytest
from fabricated_comparison import DELAY, GAIN, LIMIT, TRACK, VERDICTS, change, document, number
from test_report import Page

from residual_mpc.report.comparison import comparison_lines, comparison_page, interval_of

OPTIONAL = "audit command runs schema verdict_sentence visible".split()


@pytest.fixture(scope="module", params=VERDICTS)
def verdict(request):
    return request.param


@pytest.fixture(scope="module")
def page(verdict):
    return Page(comparison_page(document(verdict)))  # well-formed, or it raises


def test_page_is_whole_and_its_links_lead_somewhere(page):
    ids = [attributes["id"] for _, attributes in page.elements if attributes.get("id")]
    assert len(ids) == len(set(ids))
    for attributes in page.all("a"):
        assert attributes["href"].removeprefix("#") in ids
    assert [a["lang"] for a in page.all("html")] == ["en"] and len(page.all("title")) == len(page.all("h1")) == 1


def test_page_needs_nothing_else(page):
    assert not page.all("script") and not page.all("link") and not page.all("img") and not page.all("iframe")
    for _, attributes in page.elements:
        assert not any(name.startswith("on") for name in attributes)
        assert not any(str(attributes.get(name, "")).startswith(("http", "//")) for name in ("src", "href"))
    assert any("default-src 'none'" in str(meta.get("content")) for meta in page.all("meta"))


def test_tables_say_what_their_columns_are(page):
    assert len(page.all("caption")) == len(page.all("table"))
    assert all(cell.get("scope") in ("col", "row") for cell in page.all("th"))


def test_page_has_no_trace_of_what_is_missing(page):
    assert not re.search(r"\b(None|nan|undefined|inf)\b", page.text)


@pytest.mark.parametrize(
    ("verdict", "badge"),
    [("same", "no_gap\">No change found"), ("changed", "effects\">Changed"), ("partial", "partial\">Partly explained"),
     ("unknown", "unknown\">Unknown")],
)  # fmt: skip
def test_the_badge_says_the_verdict(verdict, badge):
    assert f'<span class="badge {badge}</span>' in comparison_page(document(verdict))


def test_a_difference_that_the_gap_does_not_show_is_said_to_be_finer():
    some = document("partial")
    page = comparison_page(some)
    assert "of the rise of the squared gap unexplained" in page and "is more sensitive than the gap" in page
    some["unexplained"] |= {"share": 0.4}
    page = comparison_page(some)
    assert ">Partly explained</span>" in page and "is more sensitive than the gap" not in page
    assert "is more sensitive than the gap" not in comparison_page(document("changed"))


def test_sections_follow_the_verdict():
    def titles(verdict):
        return re.findall(r"<h2[^>]*>([^<]*)</h2>", comparison_page(document(verdict)))

    for verdict in VERDICTS:
        assert titles(verdict)[0] == "Verdict" and titles(verdict)[-1] == "Definitions"
        assert "The gap before and after" in titles(verdict)
        assert ("What changed" in titles(verdict)) == (verdict in ("changed", "partial"))
    assert "Changes that cannot be told apart" in titles("partial")


def test_a_change_is_drawn_with_its_interval_and_no_change():
    page = Page(comparison_page(document("changed")))
    drawn = [a for a in page.all("div") if a.get("class") == "shift"]
    assert len(drawn) == 2 and all(a.get("aria-hidden") == "true" for a in drawn)  # the numbers are beside them
    assert page.text.count("no change") >= 2


@pytest.mark.parametrize(("one", "parameter"), [(TRACK, "scale"), (DELAY, "delay"), (GAIN, "gain")])
def test_the_drawing_has_the_proportions_of_the_numbers(one, parameter):
    place, size = interval_of(one, parameter), one["parameters"][parameter]["change"]
    none = 0.0 if one is DELAY else 1.0
    assert 0.0 < min(place.values()) and max(place.values()) < 100.0
    assert place["low"] < place["value"] < place["high"]
    scale = (place["value"] - place["none"]) / (size["value"] - none)
    assert place["high"] - place["low"] == pytest.approx(scale * (size["ci95"][1] - size["ci95"][0]))


def test_a_change_says_how_many_stretches_it_predicts_better():
    """Where that was measured: outliers are counted, not fitted."""
    assert Page(comparison_page(document("changed"))).text.count("of the stretches better") == 1
    assert "94 % of the stretches" in Page(comparison_page(document("changed"))).text


def test_what_was_not_there_before_has_no_axis():
    assert interval_of(LIMIT, "limit") is None
    without = copy.deepcopy(TRACK)
    without["parameters"]["scale"]["change"]["ci95"] = [None, None]
    assert interval_of(without, "scale") is None
    flat = change("command_delay", delay=number(0.05, 0.05, 0.0, 0.0, "s"))
    assert set(interval_of(flat, "delay").values()) == {50.0}


def test_candidates_that_were_not_named_are_listed():
    text = Page(comparison_page(document("changed"))).text
    assert "What else could explain it" in text and "actuator lag" in text.split("What else")[1]
    assert "dead zone" not in text.split("What else")[1].split("The gap before and after")[0]


def test_a_stretch_is_explained(page):
    assert "9 stretches of the runs before against 8 of the runs after" in page.text
    assert "One independent observation: a run or" in page.text


@pytest.mark.parametrize("key", OPTIONAL)
def test_a_key_that_the_contract_does_not_name_may_be_missing(key):
    Page(comparison_page({k: v for k, v in document("partial").items() if k != key}))


@pytest.mark.parametrize("key", ["before", "after", "after_explained", "noise_floor"])
def test_a_gap_that_is_not_known_is_a_dash(key, verdict):
    some = document(verdict)
    some["gap"][key] = None
    page, lines = Page(comparison_page(some)), "\n".join(comparison_lines(some))
    assert "None" not in page.text and "None" not in lines
    warned = f"No window of the runs {key} was held out"
    assert (warned in page.text) == (warned in lines) == (key in ("before", "after"))


def test_a_gap_that_rises_without_a_change_is_a_warning():
    some = document("same")
    assert "times as large" not in comparison_page(some)
    some["gap"]["after"] = 0.165
    assert "The gap is 5 times as large on the runs after" in Page(comparison_page(some)).text
    assert any("5 times as large" in line for line in comparison_lines(some))


def test_what_a_user_named_is_escaped():
    some = document("changed") | {"robot": "<script>alert(1)</script>", "notes": ["<b>&"]}
    some["changes"] = [copy.deepcopy(GAIN) | {"target": '"><img src=x>'}]
    page = Page(comparison_page(some))
    assert not page.all("script") and not page.all("img") and "<script>alert(1)</script>" in page.text


def test_lines_in_a_terminal():
    assert comparison_lines(document("changed")) == [
        "The effective track width increased by 10 %, from 106 % to 117 % of the modelled value and the command delay "
        "increased by 45 ms, from 71 ms to 116 ms.",
        "  gap at 1 s of the model fitted to the runs before: 0.033 on these runs, 0.106 on the runs after -> 0.035 "
        "with the changes, fitted to both (noise floor 0.03)",
        "  track_width: scale 1.06 -> 1.17, ratio 1.100 (1.093 to 1.107), probability 0.97",
        "  command_delay: delay 71 ms -> 116 ms, change 45 ms (26 to 64) (at the bound of its search range), "
        "probability 0.97",
        "  model errors common to both sets: track width and actuator lag",
        "  observations: 9 stretches of the runs before against 8 of the runs after "
        "(a stretch is a run or a part of one)",
    ]


def test_lines_of_what_is_in_doubt():
    some = document("partial")
    said = comparison_lines(some)
    changes = (
        "Possibly the gain of the left wheel decreased by 10 %, from 100 % to 90 % of the modelled value "
        "(or wheel radius together with track width) and an output limit appeared (4.97 rad/s); "
    )
    left = "but the errors of the two sets still differ."
    assert said[0] == f"{changes}this explains the gap, {left}"
    some["unexplained"]["share"] = 0.4
    assert comparison_lines(some)[0] == f"{changes}this explains only part of the difference between the two sets."
    assert "  saturation: limit none -> 4.97 rad/s (4.84 to 5.10), probability 0.97" in said
    assert (
        "  These runs cannot tell apart changes of actuator gain (left) and wheel radius together with track width."
        in said
    )
    assert said[-1] == "  next experiment: drive spins"


def test_the_shown_sentence_is_the_one_in_the_document(verdict):
    some = document(verdict) | {"verdict_sentence": "It is late."}
    assert "It is late." in Page(comparison_page(some)).text and comparison_lines(some)[0] == "It is late."


def test_the_smallest_visible_changes_are_told_where_none_was_found():
    same = document("same")
    told = [line for line in comparison_lines(same) if "runs would show" in line]
    assert len(told) == 1 and told[0].endswith("command delay 12 ms")  # those of all targets
    page = comparison_page(same)
    assert "<details open>" in page and "command delay 12" in page and "actuator gain (left) 3" in page
    assert not any("would show" in line for line in comparison_lines(document("changed")))
