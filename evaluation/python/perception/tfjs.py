"""Reads a graph of TensorFlow.js: a JSON with nodes, and files with weights."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Constant = NDArray[Any]


class GraphNode(NamedTuple):
    """One operation."""

    name: str
    op: str
    inputs: list[str]
    attributes: dict[str, Any]

    def integers(self, name: str) -> list[int]:
        """Returns an attribute that is a list of whole numbers; empty if it is absent."""
        return [int(it) for it in self.attributes.get(name, {}).get("list", {}).get("i", [])]

    def strings(self, name: str) -> list[str]:
        """Returns an attribute that is a list of words."""
        listed = self.attributes.get(name, {}).get("list", {}).get("s", [])
        return [base64.b64decode(it).decode() for it in listed]

    def word(self, name: str) -> str:
        """Returns an attribute that is a word."""
        return base64.b64decode(self.attributes.get(name, {}).get("s", "")).decode()

    def number(self, name: str, default: float) -> float:
        """Returns an attribute that is a number."""
        return float(self.attributes.get(name, {}).get("f", default))

    def is_set(self, name: str) -> bool:
        """Returns an attribute that is a truth value."""
        return bool(self.attributes.get(name, {}).get("b", False))

    def sizes(self, name: str) -> list[int]:
        """Returns an attribute that is a shape."""
        return [int(it["size"]) for it in self.attributes[name]["shape"]["dim"]]


class TfjsGraph:
    """The nodes by name, and the values of the constant nodes.

    Raises:
        ValueError: if the files are no such graph.
    """

    def __init__(self, path: Path) -> None:
        try:
            described = json.loads(path.read_text())
            nodes = described["modelTopology"]["node"]
            outputs = described["signature"]["outputs"].values()
            self._weights = _weights(path.parent, described["weightsManifest"])
        except (KeyError, TypeError, AttributeError, json.JSONDecodeError) as error:
            raise ValueError(f"{path}: no graph of TensorFlow.js: {error!r}") from error
        self.outputs = [str(it["name"]).split(":")[0] for it in outputs]
        self.nodes = {it["name"]: _node(it) for it in nodes}
        self._constants: dict[str, Constant | None] = {}

    def constant(self, name: str) -> Constant | None:
        """Returns the value of a node, or None if it depends on an input."""
        name = name.split(":")[0]
        if name not in self._constants:
            self._constants[name] = self._compute(self.nodes[name])
        return self._constants[name]

    def known(self, name: str) -> Constant:
        """Returns the value of a node that must be constant."""
        value = self.constant(name)
        if value is None:
            raise ValueError(f"{name} depends on the input, and must not")
        return value

    def _compute(self, node: GraphNode) -> Constant | None:
        if node.op == "Const":
            return self._weights[node.name]
        if node.op not in ("Identity", "Add", "AddV2", "SparseToDense"):
            return None
        inputs = [self.constant(it) for it in node.inputs]
        if any(it is None for it in inputs):
            return None
        if node.op == "Identity":
            return inputs[0]
        if node.op != "SparseToDense":
            return np.asarray(inputs[0] + inputs[1])  # type: ignore[operator]
        places, shape, values, default = (np.asarray(it) for it in inputs)
        dense = np.full(tuple(shape.ravel()), default)
        places = places.reshape(-1, dense.ndim)
        for place, value in zip(places, np.broadcast_to(values.ravel(), len(places)), strict=True):
            dense[tuple(place)] = value
        return dense


def padding(
    sizes: Sequence[int], spans: Sequence[int], strides: Sequence[int], kind: str
) -> tuple[list[int], list[int]]:
    """Returns the pads before and after, as TensorFlow chooses them, and the resulting sizes."""
    pads, out = [0] * 4, []
    for axis, (size, span, stride) in enumerate(zip(sizes, spans, strides, strict=True)):
        if kind == "SAME":
            total = max((-(-size // stride) - 1) * stride + span - size, 0)
            pads[axis], pads[axis + 2] = total // 2, total - total // 2
        out.append((size + pads[axis] + pads[axis + 2] - span) // stride + 1)
    return pads, out


def _node(described: dict[str, Any]) -> GraphNode:
    inputs = [it for it in described.get("input", []) if not it.startswith("^")]
    return GraphNode(described["name"], described["op"], inputs, described.get("attr", {}))


def _weights(folder: Path, manifest: list[dict[str, Any]]) -> dict[str, Constant]:
    """Reads all weights, including weights that are stored in fewer bits."""
    weights = {}
    for group in manifest:
        data = b"".join((folder / path).read_bytes() for path in group["paths"])
        at = 0
        for described in group["weights"]:
            stored = described.get("quantization", {})
            kind = np.dtype(stored.get("dtype", described["dtype"]))
            count = int(np.prod(described["shape"], dtype=np.int64))
            value = np.frombuffer(data, kind, count, at).reshape(described["shape"])
            at += value.nbytes
            if "scale" in stored:
                value = value.astype(np.float32) * stored["scale"] + stored["min"]
            weights[described["name"]] = value.astype(described["dtype"])
        if at != len(data):
            raise ValueError(f"{group['paths']}: {len(data)} bytes, the graph describes {at}")
    return weights
