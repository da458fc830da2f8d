from __future__ import annotations

from harness.recent import Recent


def test_recent_results_are_made_once_and_old_ones_are_dropped() -> None:
    made: list[str] = []
    recent = Recent(2)
    for key in "abacab":
        assert recent.get(key, lambda key=key: made.append(key) or key) == key
    assert made == ["a", "b", "c", "b"]


def test_what_was_made_of_the_same_objects_is_not_made_again() -> None:
    made: list[tuple[object, ...]] = []
    recent, one, equal = Recent(1), ["a"], ["a"]
    for parts in ((one, 1), (one, 1), (equal, 1), (equal,), (one, 1)):
        assert recent.same("name", parts, lambda parts=parts: made.append(parts) or parts) == parts
    assert [id(parts[0]) for parts in made] == [id(one), id(equal), id(equal), id(one)]
    assert recent.same("other", (one, 1), lambda: "new") == "new"
