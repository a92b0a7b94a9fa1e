"""ONNX graph of psi(i), built from the map's own parameters; the package onnx is an extra."""

from typing import Any

import numpy as np

from penode.arrays import BoolArray, FloatArray
from penode.errors import InputError
from penode.fit.fit import Fit
from penode.models.networks import ConvexGradient, TanhLayers
from penode.models.tensor_splines import folded
from penode.pmsm.machine.coenergy_map import CoenergyPart, CoenergySplines
from penode.pmsm.machine.flux_grid import FluxGrid
from penode.pmsm.machine.flux_maps import FluxMap

#: Old enough for the run times in use; the graph needs nothing newer.
_OPSET, _IR_VERSION = 17, 8


class _Graph:
    """Nodes and constants as they are added; every method returns a name."""

    def __init__(self, onnx: Any) -> None:
        self.onnx = onnx
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def node(self, operator: str, *inputs: str, output: str = "", **settings: Any) -> str:
        name = output or f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(self.onnx.helper.make_node(operator, inputs, [name], **settings))
        return name

    def constant(self, values: FloatArray | BoolArray, *, double: bool = False) -> str:
        name = f"constant_{len(self.constants)}"
        kept = values if double or values.dtype == np.bool_ else values.astype(np.float32)
        self.constants.append(self.onnx.numpy_helper.from_array(kept, name))
        return name

    def affine(self, x: str, weights: FloatArray, bias: FloatArray) -> str:
        """Return weights x + bias for rows x."""
        return self.node("Gemm", x, self.constant(weights.T), self.constant(bias))


def encode(fit: Fit, grid: FluxGrid) -> bytes:
    """Return the model: ``currents`` (batch, 2), A, to ``flux_linkage`` (batch, 2), Vs, in float32.

    ``supported`` (batch,), bool, is that of the nearest point of the grid; harmonics of the angle
    are averaged. The metadata ``temperatures`` say at which temperature the map is that of the
    magnets. Refuses maps other than ``coenergy``, ``convex`` and ``mlp``, and a missing onnx.
    """
    try:
        import onnx
    except ImportError as error:
        raise InputError(
            "the format onnx needs a package that is not installed; run pip install 'penode[onnx]'."
        ) from error
    graph = _Graph(onnx)
    # Every Fit of a machine has the field; the engine's Model does not know it.
    _add_flux(graph, fit.model.flux.averaged())  # type: ignore[attr-defined]
    _add_support(graph, grid)
    helper, number = onnx.helper, onnx.TensorProto
    model = helper.make_model(
        helper.make_graph(
            graph.nodes,
            "flux_linkage",
            [helper.make_tensor_value_info("currents", number.FLOAT, ["batch", 2])],
            [
                helper.make_tensor_value_info("flux_linkage", number.FLOAT, ["batch", 2]),
                helper.make_tensor_value_info("supported", number.BOOL, ["batch"]),
            ],
            graph.constants,
        ),
        opset_imports=[helper.make_opsetid("", _OPSET)],
        ir_version=_IR_VERSION,
        producer_name="penode",
    )
    helper.set_model_props(model, {"temperatures": grid.temperatures.of_map})
    onnx.checker.check_model(model)
    content: bytes = model.SerializeToString()
    return content


def _add_flux(graph: _Graph, flux: FluxMap) -> None:
    network, into, out = flux.network, flux.current_scale, flux.flux_scale
    if isinstance(network, CoenergySplines):
        _add_splines(graph, network, into, out)
    elif isinstance(network, ConvexGradient):
        hidden = graph.node(
            "Tanh", graph.affine("currents", network.directions / into, network.bias)
        )
        output_weights = out * (network.gain[:, None] * network.directions).T
        curved = graph.affine(hidden, output_weights, out * network.offset)
        linear = graph.node("MatMul", "currents", graph.constant(out / into * network.stiffness))
        graph.node("Add", curved, linear, output="flux_linkage")
    elif isinstance(network, TanhLayers):
        layers = [*zip(network.weights, network.biases, strict=True)]
        x, scale = "currents", into
        for weights, bias in layers[:-1]:
            x, scale = graph.node("Tanh", graph.affine(x, weights / scale, bias)), 1.0
        weights, bias = layers[-1]
        last = graph.affine(x, out * weights, out * bias)
        graph.node("Identity", last, output="flux_linkage")
    else:
        raise InputError(
            "the flux map must be coenergy, convex or mlp for ONNX, got "
            f"{type(network).__name__}; export npz, mat or c instead."
        )


def _add_splines(graph: _Graph, network: CoenergySplines, into: float, out: float) -> None:
    """Add the gradient of the splines, in double precision: divided differences cancel."""
    double = graph.onnx.TensorProto.DOUBLE
    whole = graph.node("Cast", "currents", to=double)
    x = graph.node("Div", whole, graph.constant(np.array(into), double=True))
    sums: dict[int, list[str]] = {0: [], 1: []}
    for part in network.mean:
        values, slopes = zip(*(_add_axis(graph, part, x, axis) for axis in (0, 1)), strict=True)
        table = graph.constant(np.asarray(part.coefficients[0]), double=True)
        ones = graph.constant(np.ones((part.coefficients.shape[2], 1)), double=True)
        for axis, along_d, along_q in ((0, slopes[0], values[1]), (1, values[0], slopes[1])):
            rows = graph.node("Mul", graph.node("MatMul", along_d, table), along_q)
            sums[axis].append(graph.node("MatMul", rows, ones))
    both = [graph.node("Sum", *sums[axis]) for axis in (0, 1)]
    scaled = graph.node(
        "Mul", graph.node("Concat", *both, axis=1), graph.constant(np.array(out), double=True)
    )
    graph.node("Cast", scaled, to=graph.onnx.TensorProto.FLOAT, output="flux_linkage")


def _add_axis(graph: _Graph, part: CoenergyPart, x: str, axis: int) -> tuple[str, str]:
    """Add the splines of a part along an axis and their slopes, (batch, count), at x (batch, 2)."""
    basis = part.bases[axis]

    def constant(values: FloatArray) -> str:
        return graph.constant(np.asarray(values, dtype=np.float64), double=True)

    own = graph.node("MatMul", x, constant(np.eye(2)[:, axis : axis + 1]))
    inside = graph.node(
        "Max", graph.node("Min", own, constant(np.array(1.0))), constant(-np.ones(()))
    )
    beyond = graph.node("Sub", own, inside)
    above = graph.node(
        "Max", graph.node("Sub", constant(basis.knots), inside), constant(np.zeros(()))
    )
    weights = np.zeros((len(basis.knots), basis.count))
    for k in range(basis.count):
        weights[k : k + basis.weights.shape[1], k] = basis.weights[k]
    if axis == 1:
        weights = folded(weights[None].transpose(0, 2, 1), part.even)[0].T
    outputs = []
    for power, factor in ((4.0, 1.0), (3.0, -4.0), (2.0, 12.0)):
        powers = graph.node("Pow", above, constant(np.array(power)))
        outputs.append(graph.node("MatMul", powers, constant(factor * weights)))
    value, slope, curvature = outputs
    bend = graph.node("Mul", curvature, beyond)
    half = graph.node("Mul", bend, constant(np.array(0.5)))
    rise = graph.node("Mul", graph.node("Add", slope, half), beyond)
    return graph.node("Add", value, rise), graph.node("Add", slope, bend)


def _add_support(graph: _Graph, grid: FluxGrid) -> None:
    """Add the look-up of the nearest point in the mask, a rim of False around it."""
    first = np.array([grid.i_d[0], grid.i_q[0]])
    step = np.array([np.diff(grid.i_d).mean(), np.diff(grid.i_q).mean()])
    mask = np.pad(grid.supported, 1)
    position = graph.affine("currents", np.diag(1 / step), 1 - first / step)
    rounded = graph.node("Round", position)
    limited = graph.node("Max", rounded, graph.constant(np.zeros(2)))
    limited = graph.node("Min", limited, graph.constant(np.array(mask.shape) - 1.0))
    indices = graph.node("Cast", limited, to=graph.onnx.TensorProto.INT64)
    graph.node("GatherND", graph.constant(mask), indices, output="supported")
