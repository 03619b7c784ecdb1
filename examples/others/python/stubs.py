"""Stands in for what LeRobot's and positronic's clients import and do not use here.

Torch alone is 2 GB; robots, cameras and policies are hardware. The client's own modules are theirs.
"""

from __future__ import annotations

import importlib.abc
import importlib.machinery
import sys
import types
from collections.abc import Sequence
from typing import Any, Self

import numpy as np

LEROBOT = [
    "torch",
    "draccus",
    "huggingface_hub",
    "matplotlib",
    "lerobot.cameras",
    "lerobot.robots",
    "lerobot.configs",
    "lerobot.policies",
    "lerobot.datasets",
    "lerobot.processor",
    "lerobot.lerobot_types",
    "lerobot.utils.constants",
    "lerobot.utils.feature_utils",
    "lerobot.utils.utils",
    "lerobot.utils.transition",
    "lerobot.utils.import_utils",
]
POSITRONIC = ["pos3", "positronic.drivers", "positronic.geom", "positronic.utils"]


class Tensor(np.ndarray):  # type: ignore[type-arg]
    """A tensor of torch, as far as the client looks at it."""

    device = types.SimpleNamespace(type="cpu")

    def __new__(cls, values: Sequence[float]) -> Self:
        return np.asarray(values, float).view(cls)

    def clone(self) -> Self:
        return self.copy()


class Stub(types.ModuleType):
    """A module in which every name is there."""

    __path__: Sequence[str] = []

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        if name == "Tensor":
            return Tensor
        if self.__name__ == "lerobot.utils.constants":
            return name
        if name == "wrap":  # a decorator of draccus
            return lambda *_: lambda function: function
        if name == "resolve_version":  # of positronic
            from positronic_model_server import protocol

            return lambda table, version, what: protocol.ProtocolVersion(version)
        if name[0].islower() and name != "device":
            return lambda *_, **__: None
        return type(
            name, (), {"__init__": lambda *_, **__: None, "__class_getitem__": lambda *_: None}
        )


class StubFinder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds the stubs before the real modules."""

    def find_spec(self, name: str, path: Any, target: Any = None) -> Any:
        if any(name == stub or name.startswith(stub + ".") for stub in LEROBOT + POSITRONIC):
            return importlib.machinery.ModuleSpec(name, self, is_package=True)
        return None

    def create_module(self, spec: Any) -> types.ModuleType:
        return Stub(spec.name)

    def exec_module(self, module: types.ModuleType) -> None:
        pass


sys.meta_path.insert(0, StubFinder())
