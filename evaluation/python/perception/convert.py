"""Makes ONNX of NanoDet's graph for TensorFlow.js, without TensorFlow and at any size.

    python convert.py NANODET.json FOLDER

The network is convolutional: only its input's size and what was computed from that is made again.
TensorFlow has images with channels last, ONNX first; they are kept so inside.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from models import SIZES
from tfjs import Constant, GraphNode, TfjsGraph, padding

#: The size that the graph was made for.
FROZEN = 416
#: The place of each dimension with channels first, by its place with channels last.
CHANNELS_FIRST = (0, 2, 3, 1)


class OnnxValue(NamedTuple):
    """A value of the ONNX graph."""

    name: str
    shape: tuple[int, ...]
    #: True if TensorFlow has the channels last. The ONNX graph then has them first.
    is_image: bool


class Converter:
    """Follows the graph from its outputs, node by node."""

    def __init__(self, graph: TfjsGraph, height: int, width: int) -> None:
        self._graph, self._size = graph, (height, width)
        self._nodes: list[onnx.NodeProto] = []
        self._constants: list[onnx.TensorProto] = []
        self._tensors: dict[str, OnnxValue] = {}

    def convert(self) -> onnx.ModelProto:
        """Converts the model: image in, all outputs of the graph out."""
        outputs = []
        for name in self._graph.outputs:
            tensor = self._tensor(name)
            self._nodes.append(helper.make_node("Identity", [tensor.name], [name]))
            outputs.append(helper.make_tensor_value_info(name, TensorProto.FLOAT, tensor.shape))
        shape = (1, 3, *self._size)
        image = helper.make_tensor_value_info("image", TensorProto.FLOAT, shape)
        graph = helper.make_graph(self._nodes, "nanodet", [image], outputs, self._constants)
        opset = helper.make_opsetid("", 13)
        model = helper.make_model(graph, opset_imports=[opset], ir_version=8)
        onnx.checker.check_model(model)
        return model

    def _tensor(self, name: str) -> OnnxValue:
        name = name.removesuffix(":0")
        if name not in self._tensors:
            value = self._graph.constant(name)
            node = self._graph.nodes[name.split(":")[0]]
            if value is not None:
                self._tensors[name] = OnnxValue(self._constant(value), value.shape, False)
            elif method := getattr(self, f"_{node.op.strip('_').lower()}", None):
                self._tensors[node.name] = method(node)
            else:
                raise ValueError(f"{node.name}: the operation {node.op} is not converted")
        return self._tensors[name]

    def _emit(
        self,
        op: str,
        inputs: Sequence[str],
        shape: Sequence[int],
        is_image: bool,
        **attributes: object,
    ) -> OnnxValue:
        name = f"value{len(self._nodes)}"
        self._nodes.append(helper.make_node(op, inputs, [name], **attributes))
        return OnnxValue(name, tuple(int(it) for it in shape), is_image)

    def _constant(self, value: Constant) -> str:
        name = f"constant{len(self._constants)}"
        self._constants.append(numpy_helper.from_array(np.ascontiguousarray(value), name))
        return name

    def _image(self, name: str) -> OnnxValue:
        """Returns a value with channels first."""
        tensor = self._tensor(name)
        if tensor.is_image:
            return tensor
        shape = [tensor.shape[it] for it in (0, 3, 1, 2)]
        return self._emit("Transpose", [tensor.name], shape, True, perm=(0, 3, 1, 2))

    def _plain(self, name: str) -> OnnxValue:
        """Returns a value as TensorFlow has it."""
        tensor = self._tensor(name)
        if not tensor.is_image:
            return tensor
        shape = [tensor.shape[it] for it in (0, 2, 3, 1)]
        return self._emit("Transpose", [tensor.name], shape, False, perm=(0, 2, 3, 1))

    # Each method below converts one operation.

    def _placeholder(self, node: GraphNode) -> OnnxValue:
        return OnnxValue("image", (1, 3, *self._size), node.sizes("shape")[3] == 3)

    def _identity(self, node: GraphNode) -> OnnxValue:
        return self._tensor(node.inputs[0])

    def _transpose(self, node: GraphNode) -> OnnxValue:
        order = [int(it) for it in self._graph.known(node.inputs[1])]
        tensor = self._tensor(node.inputs[0])
        if (order == [0, 3, 1, 2] and tensor.is_image) or (
            order == [0, 2, 3, 1] and not tensor.is_image
        ):
            return tensor._replace(is_image=not tensor.is_image)
        tensor = self._plain(node.inputs[0])
        shape = [tensor.shape[it] for it in order]
        return self._emit("Transpose", [tensor.name], shape, False, perm=order)

    def _conv2d(self, node: GraphNode) -> OnnxValue:
        weights = self._graph.known(node.inputs[1]).transpose(3, 2, 0, 1)
        groups = self._image(node.inputs[0]).shape[1] // weights.shape[1]
        return self._convolve(node, weights, groups)

    def _depthwiseconv2dnative(self, node: GraphNode) -> OnnxValue:
        weights = self._graph.known(node.inputs[1])
        height, width, channels, times = weights.shape
        weights = weights.transpose(2, 3, 0, 1).reshape(channels * times, 1, height, width)
        return self._convolve(node, weights, channels)

    _fusedconv2d, _fuseddepthwiseconv2dnative = _conv2d, _depthwiseconv2dnative

    def _convolve(self, node: GraphNode, weights: Constant, groups: int) -> OnnxValue:
        image, fused = self._image(node.inputs[0]), node.strings("fused_ops")
        strides = node.integers("strides")[1:3]
        dilations = (node.integers("dilations") or [1] * 4)[1:3]
        spans = [(it - 1) * by + 1 for it, by in zip(weights.shape[2:], dilations, strict=True)]
        pads, sizes = padding(image.shape[2:], spans, strides, node.word("padding"))
        inputs = [image.name, self._constant(weights)]
        if "BiasAdd" in fused:
            inputs.append(self._constant(self._graph.known(node.inputs[2])))
        shape = (1, weights.shape[0], *sizes)
        tensor = self._emit(
            "Conv",
            inputs,
            shape,
            True,
            group=groups,
            strides=strides,
            dilations=dilations,
            pads=pads,
        )
        for op in fused:
            if op == "LeakyRelu":
                slope = node.number("leakyrelu_alpha", 0.2)
                tensor = self._emit("LeakyRelu", [tensor.name], shape, True, alpha=slope)
            elif op == "Relu":
                tensor = self._emit("Relu", [tensor.name], shape, True)
            elif op != "BiasAdd":
                raise ValueError(f"{node.name}: a fused {op} is not converted")
        return tensor

    def _maxpool(self, node: GraphNode) -> OnnxValue:
        image = self._image(node.inputs[0])
        spans, strides = node.integers("ksize")[1:3], node.integers("strides")[1:3]
        pads, sizes = padding(image.shape[2:], spans, strides, node.word("padding"))
        shape = (*image.shape[:2], *sizes)
        return self._emit(
            "MaxPool", [image.name], shape, True, kernel_shape=spans, strides=strides, pads=pads
        )

    def _pad(self, node: GraphNode) -> OnnxValue:
        tensor, pads = self._tensor(node.inputs[0]), self._graph.known(node.inputs[1])
        if tensor.is_image:
            pads = pads[[0, 3, 1, 2]]
        # Before a maximum, TensorFlow pads with a value that no other is below.
        value = self._graph.known(node.inputs[2]) if len(node.inputs) > 2 else np.zeros(())
        fill = np.float32(max(float(value.ravel()[0]), -3e38))
        inputs = [
            tensor.name,
            self._constant(pads.T.ravel().astype(np.int64)),
            self._constant(fill),
        ]
        return self._emit("Pad", inputs, np.array(tensor.shape) + pads.sum(axis=1), tensor.is_image)

    _padv2 = _pad

    def _leakyrelu(self, node: GraphNode) -> OnnxValue:
        tensor = self._tensor(node.inputs[0])
        slope = node.number("alpha", 0.2)
        return self._emit("LeakyRelu", [tensor.name], tensor.shape, tensor.is_image, alpha=slope)

    def _sigmoid(self, node: GraphNode) -> OnnxValue:
        tensor = self._tensor(node.inputs[0])
        return self._emit("Sigmoid", [tensor.name], tensor.shape, tensor.is_image)

    def _add(self, node: GraphNode) -> OnnxValue:
        return self._pairwise("Add", node)

    _addv2 = _add

    def _mul(self, node: GraphNode) -> OnnxValue:
        return self._pairwise("Mul", node)

    def _pairwise(self, op: str, node: GraphNode) -> OnnxValue:
        is_image = any(self._tensor(it).is_image for it in node.inputs)
        sides = [self._side(it) if is_image else self._tensor(it) for it in node.inputs]
        shape = np.broadcast_shapes(*(it.shape for it in sides))
        return self._emit(op, [it.name for it in sides], shape, is_image)

    def _side(self, name: str) -> OnnxValue:
        """Returns an image, or a constant that is broadcast to one."""
        value = self._graph.constant(name)
        if value is None:
            return self._image(name)
        value = value.reshape((1,) * (4 - value.ndim) + value.shape).transpose(0, 3, 1, 2)
        return OnnxValue(self._constant(value), value.shape, True)

    def _concatv2(self, node: GraphNode) -> OnnxValue:
        *parts, axis = node.inputs
        number = int(self._graph.known(axis).ravel()[0])
        is_image = any(self._tensor(it).is_image for it in parts)
        tensors = [self._image(it) if is_image else self._tensor(it) for it in parts]
        number %= len(tensors[0].shape)
        number = CHANNELS_FIRST[number] if is_image else number
        shape = list(tensors[0].shape)
        shape[number] = sum(it.shape[number] for it in tensors)
        return self._emit("Concat", [it.name for it in tensors], shape, is_image, axis=number)

    def _splitv(self, node: GraphNode) -> OnnxValue:
        tensor = self._tensor(node.inputs[0])
        sizes = [int(it) for it in self._graph.known(node.inputs[1])]
        axis = int(self._graph.known(node.inputs[2]).ravel()[0]) % len(tensor.shape)
        axis = CHANNELS_FIRST[axis] if tensor.is_image else axis
        names = [f"{node.name}:{it}" for it in range(len(sizes))]
        inputs = [tensor.name, self._constant(np.array(sizes, np.int64))]
        self._nodes.append(helper.make_node("Split", inputs, names, axis=axis))
        for name, size in zip(names, sizes, strict=True):
            shape = (*tensor.shape[:axis], size, *tensor.shape[axis + 1 :])
            self._tensors[name] = OnnxValue(name, shape, tensor.is_image)
        return self._tensors[names[0]]

    def _resizebilinear(self, node: GraphNode) -> OnnxValue:
        image = self._image(node.inputs[0])
        # The image grows by the same factor at each size.
        target = int(self._graph.known(node.inputs[1]).ravel()[0])
        factor = target / round(image.shape[2] * FROZEN / self._size[0])
        mode = "half_pixel" if node.is_set("half_pixel_centers") else "asymmetric"
        shape = (*image.shape[:2], *(round(it * factor) for it in image.shape[2:]))
        factors = self._constant(np.array([1, 1, factor, factor], np.float32))
        return self._emit(
            "Resize", [image.name, "", factors], shape, True,
            mode="linear", coordinate_transformation_mode=mode,
        )  # fmt: skip

    def _reshape(self, node: GraphNode) -> OnnxValue:
        tensor = self._plain(node.inputs[0])
        shape = [int(it) for it in self._graph.known(node.inputs[1])]
        if len(shape) == 3 and len(tensor.shape) == 4:  # a head: its cells in a row
            cells = tensor.shape[2] * tensor.shape[3], tensor.shape[1] * tensor.shape[2]
            is_first = shape[1] == tensor.shape[1]
            shape = [shape[0], shape[1], cells[0]] if is_first else [shape[0], cells[1], shape[2]]
        count = int(np.prod(tensor.shape))
        shape = [count // -int(np.prod(shape)) if it == -1 else it for it in shape]
        if int(np.prod(shape)) != count:
            raise ValueError(f"{node.name}: {tensor.shape} cannot become {shape}")
        inputs = [tensor.name, self._constant(np.array(shape, np.int64))]
        return self._emit("Reshape", inputs, shape, False)


def main() -> int:
    """Converts."""
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    folder = Path(sys.argv[2])
    try:
        graph = TfjsGraph(Path(sys.argv[1]))
        for height, width in SIZES.values():
            path = folder / f"nanodet-{width}x{height}.onnx"
            part = path.with_suffix(".part")
            onnx.save(Converter(graph, height, width).convert(), part)
            part.rename(path)
            print(path)
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
