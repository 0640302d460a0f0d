"""Reading the files of a run, or of an export."""

import json
import pathlib
import struct

import numpy as np

try:
    import tomllib
except ModuleNotFoundError:  # Python before 3.11
    import tomli as tomllib

DTYPES = {"F32": np.float32, "F64": np.float64, "U64": np.uint64}


class FormatError(ValueError):
    """A file does not hold what is expected; the message names the file and says what to do."""


def read_toml(path):
    """Reads a TOML file as a dictionary."""
    try:
        return tomllib.loads(pathlib.Path(path).read_text(encoding="utf-8"))
    except ValueError as error:
        raise FormatError(f"{path} is no TOML file: {error}") from None


def read_json(path):
    """Reads a JSON file."""
    try:
        return json.loads(pathlib.Path(path).read_text(encoding="utf-8"))
    except ValueError as error:
        raise FormatError(f"{path} is no JSON file: {error}") from None


def read_safetensors(path):
    """Reads a safetensors file as arrays by name: 8 bytes of header length, a JSON header, and the arrays."""
    data = pathlib.Path(path).read_bytes()
    try:
        (length,) = struct.unpack("<Q", data[:8])
        header, body = json.loads(data[8 : 8 + length]), data[8 + length :]
        header.pop("__metadata__", None)
        tensors = {}
        for name, entry in header.items():
            begin, end = entry["data_offsets"]
            tensors[name] = np.frombuffer(body[begin:end], DTYPES[entry["dtype"]]).reshape(entry["shape"])
    except (struct.error, ValueError, KeyError, TypeError, AttributeError) as error:
        raise FormatError(f"{path} is no safetensors file, or is damaged: {error}") from None
    return tensors


def value(table, key, path):
    """Returns an entry of a file's table."""
    if key not in table:
        raise FormatError(f"{path} has no entry {key!r}; if another version of Eigenhand wrote it, export its run again")
    return table[key]


def numbers(table, key, path, shape=None):
    """Returns an entry of a file's table as an array of finite numbers; None in `shape` stands for any length."""
    entry = value(table, key, path)
    try:
        array = np.array(entry, float)
    except (TypeError, ValueError):
        raise FormatError(f"{path}: {key} is no array of numbers") from None
    if array.dtype != float or not np.isfinite(array).all():
        raise FormatError(f"{path}: {key} has numbers that are not finite")
    if shape is not None:
        fits = array.ndim == len(shape) and all(n in (None, m) for n, m in zip(shape, array.shape))
        if not fits:
            raise FormatError(f"{path}: {key} has the shape {array.shape}, and {shape} is expected")
    return array


def limits(entries, path):
    """Returns names, lower and upper limits of joints or actuators."""
    names = [value(entry, "name", path) for entry in entries]
    lower, upper = (np.array([value(entry, key, path) for entry in entries], float) for key in ("lower", "upper"))
    if not (lower <= upper).all():
        raise FormatError(f"{path}: a lower limit is above the upper one, or is no number")
    return names, lower, upper


def last_axis(array, n, what):
    """Returns an array of finite numbers whose last axis has n of them."""
    array = np.asarray(array, float)
    if array.shape[-1:] != (n,):
        raise ValueError(f"{what}: an array of shape {array.shape} was given, and (..., {n}) is expected")
    if not np.isfinite(array).all():
        raise ValueError(f"{what}: there are numbers that are not finite")
    return array
