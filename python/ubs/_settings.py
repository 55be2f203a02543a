# SPDX-License-Identifier: Apache-2.0
"""Passes settings to the library. They have the same names as in the executable and in YAML files."""

from __future__ import annotations

import ctypes
from typing import Any, Mapping

import numpy as np

from . import _abi


BOOLEANS = (bool, np.bool_)


class Settings(_abi.Handle):
    """A handle of settings in the library. `spec` is a YAML file, whose values are replaced by those in `values`. `use`
    is the purpose of the settings (_abi.USE_...). Entries of `values` that have no effect for this purpose raise
    UsageError."""

    def __init__(
        self, values: Mapping[str, Any] | None = None, spec: str | None = None, use: int | None = None
    ) -> None:
        super().__init__("settings", "settings_create")
        # A file may contain settings for other purposes, so only `values` are checked if there is a file.
        if use is not None and spec is not None:
            Settings(values, use=use)
        if spec is not None:
            _abi.call("settings_load", self, _abi.path_bytes(spec))
        for key, value in (values or {}).items():
            self.set(key, value)
        if use is not None and spec is None:
            _abi.call("settings_check", self, use)

    def set(self, key: str, value: Any) -> None:
        _abi.call("settings_set", self, key.encode(), as_text(value).encode())


def as_text(value: Any) -> str:
    """Converts a value to text: 7000 to "7000", True to "true", (1, 1, 1) to "1,1,1"."""
    if isinstance(value, BOOLEANS):
        return "true" if value else "false"
    if isinstance(value, (list, tuple, np.ndarray)):
        return ",".join(as_text(part) for part in value)
    if isinstance(value, float):
        return repr(float(value))  # the repr of NumPy's types contains the type
    return str(value)


def values_of(handle: _abi.Handle) -> dict[str, str]:
    """Returns the names and the values of all settings of a handle."""

    def value(key: bytes) -> str:
        length = ctypes.c_size_t()
        _abi.call("settings_get", handle, key, None, 0, ctypes.byref(length))
        text = ctypes.create_string_buffer(length.value + 1)
        _abi.call("settings_get", handle, key, text, len(text), None)
        return _abi.text(text.value)

    return {key: value(key.encode()) for key in settings()}


def settings() -> dict[str, str]:
    """Returns the name and the description of every setting."""
    found: dict[str, str] = {}
    for index in range(1000):
        key, help_text = ctypes.c_char_p(), ctypes.c_char_p()
        _abi.call("settings_describe", index, ctypes.byref(key), ctypes.byref(help_text))
        if key.value is None or help_text.value is None:
            break
        found[_abi.text(key.value)] = _abi.text(help_text.value)
    return found
