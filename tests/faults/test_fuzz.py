"""Readers of files on files damaged at random: a value or a sentence. The long form: `tests.faults.fuzz`."""

from __future__ import annotations

import pytest

from pipeline import UserError
from tests.faults.fuzz import cases, fuzz, sound_files


def test_every_sound_file_is_read(tmp_path):
    """Else the damage would not be what is refused."""
    for number, (kind, (name, data, read)) in enumerate(sound_files().items()):
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / name).write_bytes(data)
        try:
            read(folder / name)
        except UserError as error:
            pytest.fail(f"{kind}: {error}")


def test_a_case_is_the_same_when_it_is_made_again():
    assert next(cases(1, 7))[3] == next(cases(1, 7))[3] != next(cases(2, 7))[3]


def test_a_few_damaged_files_of_every_kind(tried):
    outcome = fuzz(seed=0, first=0, count=400)
    assert not outcome.failures
    assert sum(outcome.counts.values()) == 400
    tried("files damaged at random, all readers", "read whole, or refused in a sentence", 400)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 5))
def test_many_damaged_files(seed, tried):
    outcome = fuzz(seed=seed, first=0, count=5000)
    assert not outcome.failures
    tried("files damaged at random, all readers", "read whole, or refused in a sentence", 5000)
