import pytest

from bunraku.cli.inspecting import plainly


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "none"),
        ([], "none"),
        ({}, "none"),
        ("", "none"),
        (0, "0"),
        (True, "yes"),
        (False, "no"),
        (0.123456, "0.1235"),
        ([1, 2.5], "1; 2.5"),
        ([{"name": "walk", "frames": 3}], "name walk, frames 3"),
    ],
)
def test_values_are_put_on_one_line(value, text):
    assert plainly(value) == text
