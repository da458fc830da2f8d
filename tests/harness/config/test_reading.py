from __future__ import annotations

from pathlib import Path

import pytest

from harness.config.errors import ConfigError
from harness.config.reading import experiment_kind, load_experiment
from harness.trials.specs import build_trials


def refusal(file: Path, *overrides: str) -> str:
    with pytest.raises(ConfigError) as caught:
        build_trials(load_experiment(file, overrides), file)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(str(file))
    return message.removeprefix(f"{file}: ")


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("scan.profils=3", "scan.profils: unknown key; did you mean 'profiles'?"),
        ("scan.step_mm=-3", "scan.step_mm: should be greater than 0, not -3"),
        ("scan.step_mm=true", "scan.step_mm: should be a valid number, not True"),
        ("scan.step_mm=.inf", "scan.step_mm: should be text or a finite number, not inf"),
        ("scan.step_mm='3'", "scan.step_mm: should be a valid number, not '3'"),
        ("scan.profiles=2.5", "scan.profiles: should be a valid integer, not 2.5"),
        ("scan=3", "scan: should be keys and values, not 3"),
        ("title=2001-01-01", "title: should be text or a finite number, not 2001-01-01"),
        ("repeats=0", "repeats: should be greater than or equal to 1, not 0"),
        ("seed=-1", "seed: should be greater than or equal to 0, not -1"),
        ("tilte=x", "tilte: unknown key; did you mean 'title'?"),
        (
            "rotation_labels=swaped",
            "rotation_labels: should be 'printed', 'swapped' or 'cyclic', not 'swaped'",
        ),
        (
            "views.left.pich_deg=3",
            "views.left.pich_deg: unknown key where the kind is 'aimed'; did you mean 'pitch_deg'?",
        ),
        ("views.left.aim_mm=[0, 0]", "views.left.aim_mm.2: is missing"),
        (
            "views.right.placed_by=ab",
            "views.right.placed_by: unknown pair 'ab'; did you mean 'a.b'?",
        ),
        (
            "views.left.placed_by=a.b",
            "views.left.aim_mm: unknown key where the kind is 'placed'; known are placed_by, "
            "beyond_reach",
        ),
        (
            "views.left={placed_by: a.b}",
            "views.right.placed_by: goes in a circle: left -> right -> left",
        ),
        (
            "views.third.relative_to=letf",
            "views.third.relative_to: unknown view 'letf'; did you mean 'left'?",
        ),
        (
            "views.third={placed_by: a.b}",
            "views.third.placed_by: pair 'a.b' does not have this view",
        ),
        (
            "views.third={placed_by: plain}",
            "views.third.placed_by: pair 'plain' has no printed pose",
        ),
        ("pairs.a.b.target=rigth", "pairs.a.b.target: unknown view 'rigth'; did you mean 'right'?"),
        ("pairs.plain.target=third", "pairs.plain: source and target are the same view"),
        ("arm.bracket=3", "arm.bracket: unknown key; did you mean 'bracket_mm'?"),
        ("arm=3", "arm: should be keys and values, not 3"),
        (
            "arm={track_mm: 9000}",
            "arm: track_mm is 9000.0; the track runs from 0 to 2600 mm",
        ),
        (
            "compaction={lefd: {points: 1}}",
            "compaction.lefd: unknown view 'lefd'; did you mean 'left'?",
        ),
        (
            "pairs.a.b.printed.rotation_de=1",
            "pairs.a.b.printed.rotation_de: unknown key; did you mean 'rotation_deg'?",
        ),
        ("scene.name=dsk", "scene.name: unknown scene 'dsk'; did you mean 'desk'?"),
        ("scene.params.size=3", "scene.params.size: unknown key; none is known here"),
        ("sensor.name=jupyter", "sensor.name: unknown sensor 'jupyter'; did you mean 'jupiter'?"),
        ("sensor.params.pixels=100", "sensor.params.pixels: should be 256 or 512, not 100"),
        (
            "sensor.params.noise.gausian=false",
            "sensor.params.noise.gausian: unknown key; did you mean 'gaussian'?",
        ),
        ("methods.0.name=thesi", "methods.0.name: unknown method 'thesi'; did you mean 'thesis'?"),
        (
            "methods.0.name=nowhere:at",
            "methods.0.name: method 'nowhere:at' cannot be loaded: No module named 'nowhere'",
        ),
        (
            "methods.0.preset=literall",
            "methods.0.preset: unknown preset 'literall'; did you mean 'literal'?",
        ),
        ("methods.0.params.merg=1", "methods.0.params.merg: unknown key; did you mean 'merge'?"),
        (
            "methods.0.params.segments.warp_m=1",
            "methods.0.params.segments.warp_m: unknown key; did you mean 'warp_mm'?",
        ),
        (
            "methods.0.params.segments.warp_mm=-1",
            "methods.0.params.segments: SegmentParams.warp_mm is -1.0; must be above 0",
        ),
        ("methods=[]", "methods: needs at least 1 entry"),
        (
            "methods=[{name: thesis}, {name: thesis}]",
            "methods.1.label: 'thesis' names two methods; give each a label of its own",
        ),
        (
            "methods.0.label=''",
            "methods.0.label: String should have at least 1 character, not ''",
        ),
        (
            "methods=[{name: thesis, label: a b}, {name: thesis, label: a/b}]",
            "methods.1.label: 'a/b' and 'a b' would have the same files, a_b; rename one",
        ),
        (
            "pairs.plain_={source: third, target: left}",
            "pairs.plain_: 'plain_' and 'plain' would have the same files, plain; rename one",
        ),
        ("methods.1.name=thesis", "methods.1.name: --set: '1' is no index from 0 to 0"),
        (
            "experiment=randompairs",
            "experiment: unknown kind 'randompairs'; did you mean 'random_pairs'?",
        ),
        (
            "experiment=profiles",
            "experiment: is 'profiles'; expected 'pairs' or 'random_pairs' here",
        ),
        ("seed.x=3", "seed.x: --set: nothing called 'x' can lie in a value"),
        (
            "title=2020-13-45",
            "title: --set: is not valid YAML: '2020-13-45' cannot be read as timestamp; text goes "
            "in quotes (line 1)",
        ),
        (
            "scan={line: vertical, low_mm: -1.7e+308, high_mm: 1.7e+308, step_mm: 1.0}",
            "scan: from low_mm -1.7e+308 to high_mm 1.7e+308 in steps of 1 mm there are more than "
            "10000 profiles",
        ),
        (
            "sweep={design: sobol, samples: 2, over: {seed: {distribution: integers, from: 0, "
            "to: 18446744073709551616}}}",
            "sweep.over.seed.to: should lie within 2**53 = 9007199254740992 of 0, not "
            "18446744073709551616",
        ),
        ("profiles", "--set 'profiles' should read key=value, as scan.profiles=40"),
    ],
)
def test_a_wrong_key_or_value_gets_one_line(small_file: Path, override: str, message: str) -> None:
    assert refusal(small_file, override) == message


def test_a_pair_and_a_label_have_files_of_their_own(small_file: Path) -> None:
    pair = "pairs.plain_x={source: third, target: left}"
    methods = "methods=[{name: thesis}, {name: thesis, label: x_thesis}]"
    assert refusal(small_file, pair, methods) == (
        "pairs.plain_x: 'plain_x by thesis' and 'plain by x_thesis' would have the same files, "
        "plain_x_thesis; rename one"
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "title: a\ntitle: b\n",
            "is not valid YAML: key 'title' is written twice, again in line 2",
        ),
        ("6.4: a\n", "is not valid YAML: key 6.4 in line 1 is no text; write it in quotes"),
        ("a: [\n", "is not valid YAML: "),
        ("- a\n", "should hold keys and values"),
        ("title: &a [*a]\n", "holds an anchor that refers to itself"),
        ("", "should hold keys and values"),
        (
            "title: !!python/object:os.system {}\n",
            "is not valid YAML: could not determine a constructor",
        ),
    ],
)
def test_a_file_that_is_no_configuration_gets_one_line(
    tmp_path: Path, text: str, message: str
) -> None:
    file = tmp_path / "broken.yaml"
    file.write_text(text, encoding="utf-8")
    assert refusal(file).startswith(message)


@pytest.mark.parametrize(
    "value",
    [
        "2020-13-45",
        "0x_",
        "0b_",
        "9" * 5000,
        "0x" + "f" * 5000,
        "!!int foo",
        "!!int _",
        "!!bool foo",
        "!!timestamp foo",
        "!!map foo",
        "[" * 3000,
    ],
    ids=lambda value: value[:20],
)
def test_a_value_that_yaml_cannot_build_gets_one_line(small_file: Path, value: str) -> None:
    assert refusal(small_file, f"title={value}").startswith("title: --set: is not valid YAML: ")
    small_file.write_text(f"title: {value}\n", encoding="utf-8")
    told = refusal(small_file)
    assert told.startswith("is not valid YAML: ")
    assert len(told) < 200


def test_numbers_too_large_for_a_count_are_told(small_file: Path) -> None:
    huge = "1" + "0" * 400
    scan = f"scan={{line: vertical, low_mm: 0, high_mm: {huge}, step_mm: 1}}"
    assert refusal(small_file, scan) == "scan: low_mm, high_mm or step_mm is too large a number"


def test_a_missing_file_names_its_neighbour(small_file: Path) -> None:
    assert refusal(small_file.with_name("smal.yaml")) == (
        "no such file or directory; did you mean 'small'?"
    )


def test_a_missing_key_is_named(small_file: Path) -> None:
    text = small_file.read_text(encoding="utf-8").replace("title: ", "description: ")
    small_file.write_text(text, encoding="utf-8")
    assert refusal(small_file) == "title: is missing"


def test_overrides_reach_names_that_hold_dots_and_items_of_lists(small_file: Path) -> None:
    experiment = load_experiment(
        small_file,
        ["pairs.a.b.source=third", "scan.step_mm=1e1", "methods.0.label=mine", "repeats=7"],
        seed=9,
    )
    assert experiment.pairs["a.b"].source == "third"
    assert experiment.scan.step_mm == 10.0
    assert experiment.methods[0].label == "mine"
    assert (experiment.repeats, experiment.seed) == (7, 9)


def test_the_kind_of_an_experiment_may_be_written(small_file: Path) -> None:
    plain = load_experiment(small_file)
    with small_file.open("a", encoding="utf-8") as stream:
        stream.write("experiment: pairs\n")
    assert load_experiment(small_file) == plain
    assert experiment_kind(small_file) == "pairs"
    text = small_file.read_text(encoding="utf-8").replace(": pairs\n", ": chapter\n")
    small_file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match="experiment: unknown kind 'chapter'; did you mean 'cha"):
        experiment_kind(small_file)
