# SPDX-License-Identifier: Apache-2.0
"""The dictionary that rasterization() returns."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any, Callable, Iterator, Sequence

from torch import Tensor

from .._errors import UsageError


def _versions(tensors: Sequence[Tensor]) -> list[int]:
    """Returns a number for each tensor that increases when the tensor is changed in place. Tensors that were created in
    torch.inference_mode() have no such number; theirs is 0, and changes of them are not detected."""
    return [0 if tensor.is_inference() else tensor._version for tensor in tensors]


class Meta(dict):  # type: ignore[type-arg]
    """The values that rasterization() returns in addition to images and alphas, by their names in gsplat. Values that
    few callers need are computed when they are read."""

    def __init__(self, **values: Any) -> None:
        super().__init__(values)
        self.later: dict[str, Callable[[], Tensor]] = {}

    def compute_later(self, name: str, value: Callable[[], Tensor], *inputs: Tensor) -> None:
        """Sets a value that is computed when it is read. Reading it raises UsageError if one of `inputs` has been
        changed in place, because the value would then not describe what has been rendered."""
        versions = _versions(inputs)

        def checked() -> Tensor:
            if _versions(inputs) != versions:
                raise UsageError(
                    f"meta['{name}'] is computed when it is read, but the tensors have been changed since they were "
                    f"rendered: read it earlier, before the step of the optimiser"
                )
            return value()

        super().pop(name, None)
        self.later[name] = checked

    def reader(self, name: str) -> Callable[[], Tensor]:
        """Returns a function that returns a value of this dictionary, and that does not keep the dictionary alive."""
        if name in self.later:
            return self.later[name]
        value: Tensor = self[name]
        return lambda: value

    def __missing__(self, key: str) -> Any:
        if key in self.later:
            self[key] = self.later[key]()
            return self[key]
        raise KeyError(f"{key}: ubs does not return this value: choose one of {', '.join(self)}")

    # dict() and similar functions read the values with keys() and [], because __iter__ is overridden.
    def keys(self) -> Any:
        return dict.fromkeys([*super().keys(), *self.later]).keys()

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def __len__(self) -> int:
        return len(self.keys())

    def __contains__(self, key: object) -> bool:
        return key in self.keys()

    def get(self, key: str, default: Any = None) -> Any:
        return self[key] if key in self else default

    def copy(self) -> dict[str, Any]:
        return {name: self[name] for name in self}

    def values(self) -> Any:
        return self.copy().values()

    def items(self) -> Any:
        return self.copy().items()

    def __setitem__(self, key: str, value: Any) -> None:
        self.later.pop(key, None)
        super().__setitem__(key, value)

    def __delitem__(self, key: str) -> None:
        self.pop(key)

    def pop(self, key: str, *default: Any) -> Any:
        if key in self.later:
            self[key]  # computes it
        return super().pop(key, *default)

    def setdefault(self, key: str, default: Any = None) -> Any:
        if key not in self:
            self[key] = default
        return self[key]

    def __or__(self, other: Any) -> Any:
        return self.copy() | other

    def __repr__(self) -> str:
        return repr({name: "computed when it is read" if name in self.later else self[name] for name in self})

    def __reduce__(self) -> Any:
        # With weights_only=True, torch.load() calls OrderedDict, but refuses to call dict.
        return OrderedDict, (), None, None, iter(self.copy().items())
