import pytest

from bunraku.neural.anatomy import ANATOMIES, PERSON, QUADRUPED
from bunraku.types import NO_PARENT


@pytest.mark.parametrize("anatomy", ANATOMIES.values(), ids=lambda anatomy: anatomy.kind)
def test_parents_come_before_children_and_the_first_part_is_the_only_root(anatomy):
    assert anatomy.parents[0] == NO_PARENT and (anatomy.parents[1:] >= 0).all()
    assert all(parent < part for part, parent in enumerate(anatomy.parents))


@pytest.mark.parametrize("anatomy", ANATOMIES.values(), ids=lambda anatomy: anatomy.kind)
def test_twins_are_mutual_and_hang_on_twins(anatomy):
    twins = anatomy.twins
    assert (twins[twins] == range(len(twins))).all()
    for part, parent in enumerate(anatomy.parents[1:], start=1):
        assert anatomy.parents[twins[part]] == twins[parent]


def test_a_part_goes_on_where_it_ends_not_in_a_branch():
    names = PERSON.names
    goes_on = {
        name: names[after] for name, after in zip(names, PERSON.children, strict=True) if after >= 0
    }
    assert goes_on["hips"] == "spine" and goes_on["upperChest"] == "neck"
    assert goes_on["leftUpperArm"] == "leftLowerArm" and "head" not in goes_on
    assert QUADRUPED.names[QUADRUPED.children[QUADRUPED.index("chest")]] == "neck"
