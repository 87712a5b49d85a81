"""Store the weights of convolutions and dense layers as float16, and nothing else.

The converter's own float16 mode halves every large constant: ranges of labels and other constants of the
geometry lose their digits, and the graph's indices with them.
"""

from typing import Any

import numpy as np
from tensorflow.lite.python import schema_py_generated as schema
from tensorflow.lite.tools import flatbuffer_utils

_WITH_WEIGHTS = {
    schema.BuiltinOperator.CONV_2D,
    schema.BuiltinOperator.DEPTHWISE_CONV_2D,
    schema.BuiltinOperator.FULLY_CONNECTED,
}
_FEWEST = 1024
"""Smaller weights stay as they are."""


def halve_weights(model: bytes) -> bytes:
    """Return a float32 graph whose weights are float16 with a conversion before their use, as LiteRT expects
    them."""
    graph = flatbuffer_utils.convert_bytearray_to_object(bytearray(model))
    dequantize = _find_operator_code(graph, schema.BuiltinOperator.DEQUANTIZE)
    halves: dict[int, int] = {}
    for subgraph in graph.subgraphs:
        conversions = []
        for index in sorted(_list_weights(graph, subgraph)):
            tensor = subgraph.tensors[index]
            if tensor.buffer not in halves:
                halves[tensor.buffer] = _add_half(graph, tensor.buffer)
            half = schema.TensorT()
            half.shape, half.type = tensor.shape, schema.TensorType.FLOAT16
            half.buffer = halves[tensor.buffer]
            half.name = tensor.name + b"_half"
            tensor.buffer = 0
            subgraph.tensors.append(half)
            conversion = schema.OperatorT()
            conversion.opcodeIndex = dequantize
            conversion.inputs, conversion.outputs = [len(subgraph.tensors) - 1], [index]
            conversions.append(conversion)
        subgraph.operators = conversions + list(subgraph.operators)
    used = {tensor.buffer for subgraph in graph.subgraphs for tensor in subgraph.tensors}
    for buffer in set(halves) - used:
        graph.buffers[buffer].data = None
    return bytes(flatbuffer_utils.convert_object_to_bytearray(graph))


def _add_half(graph: Any, buffer: int) -> int:
    """Add a buffer with float16 of the float32 in `buffer` and return its index."""
    values = np.frombuffer(bytes(graph.buffers[buffer].data), np.float32)
    half = schema.BufferT()
    half.data = np.frombuffer(values.astype(np.float16).tobytes(), np.uint8)
    graph.buffers.append(half)
    return len(graph.buffers) - 1


def _list_weights(graph: Any, subgraph: Any) -> set[int]:
    """Return the tensors of a subgraph that are weights and nothing else."""
    weights: set[int] = set()
    others = set(subgraph.inputs) | set(subgraph.outputs)
    for operator in subgraph.operators:
        code = graph.operatorCodes[operator.opcodeIndex]
        kind = max(code.builtinCode, code.deprecatedBuiltinCode)
        for place, index in enumerate(operator.inputs):
            (weights if kind in _WITH_WEIGHTS and place == 1 else others).add(index)

    def is_large(index: int) -> bool:
        tensor = subgraph.tensors[index]
        data = graph.buffers[tensor.buffer].data
        return tensor.type == schema.TensorType.FLOAT32 and data is not None and len(data) >= 4 * _FEWEST

    return {index for index in weights - others if is_large(index)}


def _find_operator_code(graph: Any, kind: int) -> int:
    """Return the index of an operator's code, added where the graph has none."""
    for index, code in enumerate(graph.operatorCodes):
        if max(code.builtinCode, code.deprecatedBuiltinCode) == kind:
            return index
    code = schema.OperatorCodeT()
    code.builtinCode = code.deprecatedBuiltinCode = kind
    # The first version that reads float16.
    code.version = 3
    graph.operatorCodes.append(code)
    return len(graph.operatorCodes) - 1
