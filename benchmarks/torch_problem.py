"""The shared problem written in torch and integrated by torchdiffeq, as a reference and a rival.

Kutta's 3/8 rule (which torchdiffeq calls rk4) at one step a sample, the input held from sample to
sample, float64. torchdiffeq differentiates through its solver (no adjoint). Leaves are those of
`penode.pmsm.machine.model.Machine` in order: three weights, three biases, if there is a linear map
beside the network its matrix and offset, and R.
"""

from collections.abc import Callable, Sequence

import jax
import numpy as np

from benchmarks.problem import Problem
from penode.data.windows import Windows

try:
    import torch
    from torchdiffeq import odeint
except ImportError as missing:
    raise SystemExit(
        f"{missing.name} is not installed; only the benchmarks against torch need it: install "
        "penode and benchmarks/requirements.txt into an environment of their own, run them there."
    ) from None

#: (leaves without R, x (batch, 2)) -> output (batch, 2) and its Jacobian (batch, 2, 2).
Network = Callable[[Sequence[torch.Tensor], torch.Tensor], tuple[torch.Tensor, torch.Tensor]]


def closed_form(leaves: Sequence[torch.Tensor], x: torch.Tensor) -> tuple:
    """Return the map's output and Jacobian, both written out."""
    weights, biases, beside = leaves[:3], leaves[3:6], leaves[6:]
    hidden = torch.tanh(x @ weights[0].T + biases[0])
    slope = (1 - hidden**2)[..., None] * weights[0]
    hidden = torch.tanh(hidden @ weights[1].T + biases[1])
    slope = (1 - hidden**2)[..., None] * (weights[1] @ slope)
    value, jacobian = hidden @ weights[2].T + biases[2], weights[2] @ slope
    if beside:
        return value + x @ beside[0].T + beside[1], jacobian + beside[0]
    return value, jacobian


def by_torch_func(leaves: Sequence[torch.Tensor], x: torch.Tensor) -> tuple:
    """Return the network's output and its Jacobian by torch.func."""
    weights, biases = leaves[:3], leaves[3:6]

    def network(point: torch.Tensor) -> torch.Tensor:
        for weight, bias in zip(weights[:-1], biases[:-1], strict=True):
            point = torch.tanh(weight @ point + bias)
        return weights[-1] @ point + biases[-1]

    return torch.func.vmap(network)(x), torch.func.vmap(torch.func.jacfwd(network))(x)


def cramer(matrix: torch.Tensor, vector: torch.Tensor) -> torch.Tensor:
    """Solve systems (batch, 2, 2) of two equations by hand."""
    (a, b), (c, d) = (row.unbind(1) for row in matrix.unbind(1))
    first, second = vector.unbind(1)
    top = torch.stack([d * first - b * second, a * second - c * first], dim=1)
    return top / (a * d - b * c)[:, None]


def derivative_of(problem: Problem, network: Network, solve: Callable) -> Callable:
    """Return di/dt (batch, 2) in A a sample as a function of leaves, i and u (batch, 3)."""
    flux, width = problem.machine.flux, problem.run.time_step
    current_scale, flux_scale = flux.current_scale, flux.flux_scale

    def derivative(
        leaves: Sequence[torch.Tensor], x: torch.Tensor, u: torch.Tensor
    ) -> torch.Tensor:
        value, jacobian = network(leaves[:-1], x / current_scale)
        psi, inductance = flux_scale * value, flux_scale / current_scale * jacobian
        turned = torch.stack([-psi[:, 1], psi[:, 0]], dim=1)
        return width * solve(inductance, u[:, :2] - leaves[-1] * x - u[:, 2:] * turned)

    return derivative


def leaves_of(problem: Problem) -> list[torch.Tensor]:
    """Return the machine's values to be differentiated."""
    return [torch.tensor(leaf, requires_grad=True) for leaf in jax.tree.leaves(problem.machine)]


def loss_of(windows: Windows, derivative: Callable) -> Callable:
    """Return the loss through torchdiffeq as a function of leaves and of which windows count."""
    horizon = windows.horizon
    at = np.arange(horizon)[:, None] + windows.starts
    inputs, targets = torch.tensor(windows.inputs[at]), torch.tensor(windows.states[at + 1])
    start = torch.tensor(windows.states[windows.starts])
    samples = torch.arange(horizon + 1, dtype=torch.float64)

    def loss(leaves: Sequence[torch.Tensor], chosen: slice | np.ndarray) -> torch.Tensor:
        driven, wanted = inputs[:, chosen], targets[:, chosen]

        def field(t: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
            return derivative(leaves, x, driven[int(t)])

        # perturb: the last stage of a step still sees the step's own input.
        path = odeint(field, start[chosen], samples, method="rk4", options={"perturb": True})
        return torch.mean((wanted - path[1:]) ** 2)

    return loss


def loss_and_gradient(problem: Problem, windows: Windows, derivative: Callable) -> Callable:
    """Return a function that gives loss and gradient (parameter,) through torchdiffeq."""
    leaves, loss = leaves_of(problem), loss_of(windows, derivative)

    def evaluate() -> tuple[float, np.ndarray]:
        value = loss(leaves, slice(None))
        slopes = torch.autograd.grad(value, leaves)
        return value.item(), np.concatenate([slope.numpy().ravel() for slope in slopes])

    return evaluate
