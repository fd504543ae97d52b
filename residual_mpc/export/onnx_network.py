"""The learned network as ONNX, and a network from ONNX: Gemm and LeakyRelu, as CasADi 3.8 and others read them."""

from pathlib import Path
from typing import Any

import numpy as np

from residual_mpc.errors import BadInput
from residual_mpc.extras import extra
from residual_mpc.learning.network.mlp import Mlp, layers
from residual_mpc.learning.network.residual import Residual

OPSET = 17


def to_onnx(residual: Residual, path: Path) -> float:
    """Write delta(z) in physical units, z (rows, inputs) -> delta (rows, outputs); scaling is part of the graph.

    Returns the largest difference from the learned network over sampled inputs, in the outputs' units.
    Raises BadInput where ONNX is not installed.
    """
    onnx = _onnx()
    from onnx import helper, numpy_helper

    r = residual
    tensors = {"mean": r.input_mean, "input_scale": r.input_scale, "output_scale": r.output_scale}
    nodes = [
        helper.make_node("Sub", ["z", "mean"], ["centred"]),
        helper.make_node("Div", ["centred", "input_scale"], ["a0"]),
    ]
    last = "a0"
    if np.isfinite(r.limit):
        tensors |= {"low": np.array(-r.limit), "high": np.array(r.limit)}
        nodes.append(helper.make_node("Clip", ["a0", "low", "high"], ["a0_held"]))
        last = "a0_held"
    parts = layers(r.net, r.theta)
    for i, (weight, bias) in enumerate(parts):
        tensors |= {f"W{i}": weight, f"b{i}": bias}
        nodes.append(helper.make_node("Gemm", [last, f"W{i}", f"b{i}"], [f"g{i}"], transB=1))
        last = f"g{i}"
        if i < len(parts) - 1:
            nodes.append(helper.make_node("LeakyRelu", [last], [f"a{i + 1}"], alpha=r.net.slope))
            last = f"a{i + 1}"
    nodes.append(helper.make_node("Mul", [last, "output_scale"], ["delta"]))
    double = onnx.TensorProto.DOUBLE
    graph = helper.make_graph(
        nodes,
        "residual",
        [helper.make_tensor_value_info("z", double, ["rows", r.net.inputs])],
        [helper.make_tensor_value_info("delta", double, ["rows", r.net.outputs])],
        [numpy_helper.from_array(np.asarray(v, dtype=np.float64), n) for n, v in tensors.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], producer_name="residual-mpc")
    helper.set_model_props(model, {"inputs": ", ".join(r.inputs), "outputs": ", ".join(r.outputs), "form": r.form})
    onnx.checker.check_model(model)
    path.parent.mkdir(parents=True, exist_ok=True)
    onnx.save(model, str(path))
    from onnx.reference import ReferenceEvaluator

    most = 1.5 * r.limit if np.isfinite(r.limit) else 4.0  # beyond the limit too
    z = r.input_mean + r.input_scale * np.random.default_rng(0).uniform(-most, most, (500, r.net.inputs))
    (delta,) = ReferenceEvaluator(str(path)).run(None, {"z": z})
    return float(np.abs(delta - r(z)).max())


def from_onnx(path: Path) -> tuple[Mlp, np.ndarray]:
    """(net, theta (size,)) of a chain of Gemm (transB 0 or 1) and LeakyRelu of one slope, with nothing around it.

    Raises BadInput for a file that is no ONNX, or a graph of another kind: nothing in it is skipped silently.
    """
    onnx = _onnx()
    from onnx import numpy_helper

    try:
        graph = onnx.load(str(path)).graph
    except Exception as error:  # protobuf raises its own errors for what is no ONNX
        raise BadInput(f"cannot be read as ONNX: {error}", str(path), "give a file written by onnx.save") from error
    tensors = {t.name: numpy_helper.to_array(t).astype(np.float64) for t in graph.initializer}
    weights: list[tuple[np.ndarray, np.ndarray]] = []
    slopes: list[float] = []
    at = next((i.name for i in graph.input if i.name not in tensors), "")
    for node in graph.node:
        attributes = {a.name: onnx.helper.get_attribute_value(a) for a in node.attribute}
        if not node.input or node.input[0] != at:
            raise _foreign(path, f"node {node.name or node.op_type} outside the chain")
        if node.op_type == "Gemm" and len(node.input) == 3 and len(slopes) == len(weights):
            if {attributes.get("alpha", 1.0), attributes.get("beta", 1.0)} != {1.0} or attributes.get("transA", 0):
                raise _foreign(path, "Gemm with alpha, beta or transA")
            w = tensors[node.input[1]]
            weights.append((w if attributes.get("transB", 0) else w.T, tensors[node.input[2]].ravel()))
        elif node.op_type == "LeakyRelu" and len(slopes) == len(weights) - 1:
            slopes.append(float(np.float32(attributes.get("alpha", 0.01))))
        else:
            raise _foreign(path, f"a {node.op_type} node at position {len(weights) + len(slopes)}")
        at = node.output[0]
    if len(weights) < 2 or len(slopes) != len(weights) - 1 or len(set(slopes)) != 1:
        raise _foreign(path, f"{len(weights)} Gemm and {len(slopes)} LeakyRelu nodes with slopes {sorted(set(slopes))}")
    hidden = tuple(len(b) for _, b in weights[:-1])
    # an attribute is a 32-bit float: 0.01 comes back as 0.00999999978
    net = Mlp(weights[0][0].shape[1], hidden, len(weights[-1][1]), round(slopes[0], 7))
    return net, np.concatenate([np.concatenate([w.ravel(), b]) for w, b in weights])


def _foreign(path: Path, what: str) -> BadInput:
    return BadInput(
        f"must be a chain Gemm, LeakyRelu, ..., Gemm with one slope, got {what}",
        str(path),
        "export linear layers with one LeakyReLU slope between them, without scaling layers",
    )


def _onnx() -> Any:
    with extra("onnx"):
        import onnx
        import onnx.checker
        import onnx.helper
    return onnx
