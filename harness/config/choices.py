"""What a config chooses from a registry: the entry with all its parameters, checked once."""

from __future__ import annotations

import dataclasses
import functools
import json
import os
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel, ConfigDict, create_model

from harness.config.errors import ConfigError, Key, nearest
from harness.config.reading import validated
from harness.config.schema import Choice, MethodChoice
from harness.recent import Recent
from registration.calibration import CalibrationError, read_calibration
from registration.methods import METHODS, UnknownMethodError, find_method
from registration.peers import PEERS, MissingPeerError, check_installed

# Of a field that came later: as long as it is None, trials keep the ids they had before.
LATER: Mapping[str, Any] = {"left_out": None}

_FIELDS: dict[type, list[tuple[str, bool]]] = {}  # sorted; whether None leaves one out


def canonical_json(value: Any) -> str:
    """Dataclasses and plain values as JSON with sorted keys: the same text on every machine."""
    return _CANONICAL.encode(value)


def joined_json(value: Any) -> str:
    """canonical_json of a dataclass, from the texts that its parts keep as `text`."""
    fields = ((name, getattr(value, name)) for name in _names(value))
    parts = [f'"{name}":{text_of(part)}' for name, part in fields]
    return "{" + ",".join(parts) + "}"


def text_of(value: Any) -> str:
    """canonical_json of a value; a part that is shared by many trials keeps its own as `text`."""
    if type(value) is int:  # the commonest, which need no encoder
        return repr(value)
    text: str | None = getattr(value, "text", None)
    return canonical_json(value) if text is None else text


def list_json(values: Iterable[Any]) -> str:
    """canonical_json of a list, from the texts that its entries keep."""
    return "[" + ",".join(text_of(value) for value in values) + "]"


def _names(value: Any) -> list[str]:
    """The fields of a dataclass that determine a trial, sorted."""
    fields = _FIELDS.get(type(value))
    if fields is None:
        found = dataclasses.fields(value)
        fields = _FIELDS[type(value)] = sorted((f.name, f.metadata == LATER) for f in found)
    return [name for name, later in fields if not (later and getattr(value, name) is None)]


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {name: getattr(value, name) for name in _names(value)}
    if isinstance(value, BaseModel):
        return value.model_dump()
    raise TypeError(f"{type(value).__name__} cannot determine a trial")


_CANONICAL = json.JSONEncoder(
    default=_plain, sort_keys=True, separators=(",", ":"), allow_nan=False
)


@dataclass(frozen=True)
class Chosen:
    """An entry of a registry with all its parameters, defaults filled in."""

    name: str
    params: Any

    @functools.cached_property
    def text(self) -> str:
        """Its canonical JSON, made once for all the trials that share it."""
        return joined_json(self)

    @functools.cached_property
    def noiseless(self) -> Noiseless:
        """The same without the noise of a sensor."""
        params = self.params
        if hasattr(params, "noise"):
            params = dataclasses.replace(params, noise=None)
        return Noiseless(canonical_json([self.name, params]))


class Noiseless(NamedTuple):
    """What remains of a sensor without its noise, as canonical JSON."""

    text: str


def chosen(choice: Choice, registry: Mapping[str, Any], key: Key, file: Path) -> Chosen:
    """The entry of a registry that the config names, with checked parameters."""
    if choice.name not in registry:
        message = f"unknown {key[-1]} {choice.name!r}; {nearest(choice.name, registry)}"
        raise ConfigError(file, (*key, "name"), message)
    params_type = registry[choice.name].params_type
    return Chosen(choice.name, checked_params(params_type, choice.params, file, (*key, "params")))


def kept_choice(
    choice: Choice, registry: Mapping[str, Any], name: str, file: Path, kept: Recent
) -> Chosen:
    """chosen of a key of the config; what was checked before is kept."""
    return kept.same(
        name,
        (choice.name, choice.params),
        lambda: kept.get(
            f"{name} {text_of(choice)}", lambda: chosen(choice, registry, (name,), file)
        ),
    )


def chosen_method(choice: MethodChoice, key: Key, file: Path) -> Chosen:
    """The method that the config names, with checked parameters, installed if it is a peer."""
    try:
        params_type = find_method(choice.name).params_type
    except UnknownMethodError as error:
        message = " ".join(str(error).split())  # it says why one of the user's own does not load
        if ":" not in choice.name:
            message = f"unknown method {choice.name!r}; {nearest(choice.name, METHODS)}"
        raise ConfigError(file, (*key, "name"), message) from None
    if choice.given and choice.name != "thesis":
        raise ConfigError(
            file, (*key, "given"), "only method 'thesis' can be entered with the truth"
        )
    preset: dict[str, Any] = {}
    if choice.preset is not None:
        presets = _presets(params_type)
        if choice.preset not in presets:
            message = f"unknown preset {choice.preset!r}; {nearest(choice.preset, presets)}"
            raise ConfigError(file, (*key, "preset"), message)
        preset = dataclasses.asdict(getattr(params_type, choice.preset)())
    merged = _merged(preset, choice.params)
    params = checked_params(params_type, merged, file, (*key, "params"))
    calibration = getattr(params, "calibration", "")
    if calibration:
        found = _calibration_file(calibration, file, (*key, "params", "calibration"))
        params = dataclasses.replace(params, calibration=found)
    if choice.name in PEERS:
        try:
            check_installed(choice.name, params)
        except MissingPeerError as error:
            raise ConfigError(file, (*key, "name"), f"{choice.name}: {error}") from None
    return Chosen(choice.name, params)


def chosen_methods(choices: Sequence[MethodChoice], file: Path, kept: Recent) -> tuple[Chosen, ...]:
    """chosen_method of every entry of the key `methods`; what was checked before is kept."""
    return tuple(
        kept.get(
            f"method {index} {text_of(choice)}",
            functools.partial(chosen_method, choice, ("methods", index), file),
        )
        for index, choice in enumerate(choices)
    )


def _calibration_file(calibration: str, file: Path, key: Key) -> str:
    """Where a calibration lies: beside the config that names it, or below the current folder.

    Told from the current folder, so that a trial is the same on every machine. Raises ConfigError,
    of a file that is no calibration too.
    """
    beside = Path(file).parent / calibration
    if beside.is_file():
        found = calibration if Path(calibration).is_absolute() else os.path.relpath(beside)
    elif Path(calibration).is_file():
        found = calibration
    else:
        places = f"beside {file} nor below {Path.cwd()}"
        message = f"{calibration} is no file {places}; configs/precision.yaml makes one"
        raise ConfigError(file, key, message)
    try:
        read_calibration(found)
    except OSError as error:
        message = f"{found} cannot be read ({error.strerror}); configs/precision.yaml makes one"
        raise ConfigError(file, key, message) from None
    except CalibrationError as error:
        message = f"{' '.join(str(error).split())}; configs/precision.yaml makes one"
        raise ConfigError(file, key, message) from None
    return found


def installed_methods(
    choices: Sequence[MethodChoice], file: Path
) -> tuple[tuple[MethodChoice, ...], tuple[str, ...]]:
    """The methods that can run, and of the optional ones that cannot, why; raises ConfigError.

    Nothing is left out where nothing would be left.
    """
    kept, reasons = [], []
    for index, choice in enumerate(choices):
        if choice.optional and choice.name in PEERS:
            params = checked_params(
                PEERS[choice.name].params_type, choice.params, file, ("methods", index, "params")
            )
            try:
                check_installed(choice.name, params)
            except MissingPeerError as error:
                reasons.append(f"{choice.called} is left out: {error}")
                continue
        kept.append(choice)
    if not kept:
        return tuple(choices), ()
    return tuple(kept), tuple(reasons)


def _presets(params_type: type) -> list[str]:
    """Names of the public class methods of a params type: each makes one set of parameters."""
    return [
        name
        for name, member in vars(params_type).items()
        if isinstance(member, classmethod) and not name.startswith("_")
    ]


def checked_params(params_type: type, params: dict[str, Any], file: Path | str, key: Key) -> Any:
    """Parameters as their dataclass, unknown names refused at every depth; raises ConfigError."""
    if not dataclasses.is_dataclass(params_type):
        return params
    name = str(key[-1])
    model = _model_of(params_type, name)
    return getattr(validated(model, {name: params}, file, key[:-1]), name)


@functools.cache
def _model_of(params_type: Hashable, name: str) -> type[BaseModel]:
    config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    fields: dict[str, Any] = {name: (params_type, ...)}
    return create_model("Params", __config__=config, **fields)


def _merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for name, value in changes.items():
        if isinstance(value, dict) and isinstance(base.get(name), dict):
            merged[name] = _merged(base[name], value)
        else:
            merged[name] = value
    return merged
