"""Seals: what was committed to cannot be changed, and says nothing before it is revealed."""

import json

import pytest
from answers import answer

from residual_mpc.blind.records import answer_from
from residual_mpc.blind.seal import reveal, seal, write_sealed
from residual_mpc.errors import BadInput


@pytest.fixture
def sealed(tmp_path):
    case = tmp_path / "case"
    case.mkdir()
    (case / "run1.csv").write_text("t\n0\n")
    sealed = seal(answer(("slope", None, {"rate": 0.1}), twins=(("wheel_radius",),)), case)
    write_sealed(sealed, tmp_path / "answer.json")
    return sealed, tmp_path


def test_an_answer_comes_back_as_it_was(sealed):
    it, place = sealed
    assert reveal(place / "answer.json", it.commitment, place / "case") == it.answer
    assert answer_from(json.loads(json.dumps(it.answer.document()))) == it.answer


def test_equal_answers_have_commitments_that_differ(sealed):
    it, place = sealed
    assert seal(it.answer, place / "case").commitment != it.commitment


@pytest.mark.parametrize(("old", "new"), [('"slope"', '"backlash"'), ('"rate": 0.1', '"rate": 0.2')])
def test_a_changed_answer_is_refused(sealed, old, new):
    it, place = sealed
    path = place / "answer.json"
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(BadInput, match="does not match its commitment"):
        reveal(path, it.commitment, place / "case")


def test_changed_data_are_refused(sealed):
    it, place = sealed
    (place / "case" / "run1.csv").write_text("t\n1\n")
    with pytest.raises(BadInput, match="have changed since"):
        reveal(place / "answer.json", it.commitment, place / "case")


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"answer": 3, "data": "", "salt": ""}'])
def test_a_broken_answer_is_one_clear_message(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(BadInput, match="not a sealed answer"):
        reveal(tmp_path / "a.json", "", tmp_path)
