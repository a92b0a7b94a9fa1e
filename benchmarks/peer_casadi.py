"""Peers on CasADi: SciPy's least squares on single shooting; IPOPT on shooting and collocation."""

import casadi as ca
import numpy as np
from scipy.optimize import least_squares

from benchmarks.peer_models import Problem
from penode.arrays import FloatArray


def field(problem: Problem):
    """Return x' as a function of x, inputs at both ends, the place between them and theta."""
    states, inputs, parameters = problem.sizes
    x, theta = ca.SX.sym("x", states), ca.SX.sym("theta", parameters)
    now, then, at = ca.SX.sym("u", inputs), ca.SX.sym("v", inputs), ca.SX.sym("at")
    u = now + at * (then - now) if problem.by_hand.straight else now
    p = problem.parameters(ca, theta)
    rates = problem.by_hand.derivative(ca, ca.vertsplit(x), ca.vertsplit(u), p)
    return ca.Function("field", [x, now, then, at, theta], [ca.vertcat(*rates)])


def step(problem: Problem):
    """Return the classic Runge-Kutta step over a sample."""
    states, inputs, parameters = problem.sizes
    x, theta = ca.SX.sym("x", states), ca.SX.sym("theta", parameters)
    now, then = ca.SX.sym("u", inputs), ca.SX.sym("v", inputs)
    f, h = field(problem), problem.time_step
    k1 = f(x, now, then, 0, theta)
    k2 = f(x + h / 2 * k1, now, then, 0.5, theta)
    k3 = f(x + h / 2 * k2, now, then, 0.5, theta)
    k4 = f(x + h * k3, now, then, 1, theta)
    ahead = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return ca.Function("step", [x, now, then, theta], [ahead])


class SingleShooting:
    """SciPy's `least_squares` on CasADi's simulation with forward sensitivities."""

    def __init__(self, problem: Problem):
        self.problem = problem
        states, inputs, parameters = problem.sizes
        size = parameters + states
        x, theta = ca.SX.sym("x", states), ca.SX.sym("theta", parameters)
        now, then = ca.SX.sym("u", inputs), ca.SX.sym("v", inputs)
        slope = ca.SX.sym("S", states, size)
        ahead = step(problem)(x, now, then, theta)
        moved = ca.jacobian(ahead, x) @ slope
        moved[:, :parameters] += ca.jacobian(ahead, theta)
        one = ca.Function(
            "one", [ca.horzcat(x, slope), now, then, theta], [ca.horzcat(ahead, moved)]
        )
        samples = len(problem.inputs) - 1
        self.run = one.mapaccum("run", samples)
        self.plain = step(problem).mapaccum("plain", samples)
        self.ends = problem.inputs[:-1].T, problem.inputs[1:].T
        self.theta = np.zeros(size)

    def path(self, theta: FloatArray) -> FloatArray:
        """Return states (time, state)."""
        first = self.first(theta)
        rest = self.plain(first, *self.ends, self.tied(theta))
        return np.vstack([first, np.array(rest).T])

    def first(self, theta: FloatArray) -> FloatArray:
        """Return the state at the first sample."""
        return self.problem.guess + self.problem.spread * theta[-len(self.problem.guess) :]

    def tied(self, theta: FloatArray) -> FloatArray:
        """Return theta of the parameters."""
        return theta[: len(self.problem.start)]

    def known(self, theta: FloatArray) -> Problem:
        """Return the problem with the parameters of theta."""
        return self.problem.fixed(self.tied(theta))

    def residual(self, theta: FloatArray) -> FloatArray:
        """Return the scaled errors."""
        error = self.path(theta)[:, self.problem.rows] - self.problem.outputs
        return np.nan_to_num(error * self.problem.weights, nan=1e6, posinf=1e6, neginf=-1e6).ravel()

    def jacobian(self, theta: FloatArray) -> FloatArray:
        """Return the slopes of the scaled errors."""
        states, _, parameters = self.problem.sizes
        size = parameters + states
        slope = np.hstack([np.zeros((states, parameters)), np.diag(self.problem.spread)])
        begin = np.hstack([self.first(theta)[:, None], slope])
        path = np.array(self.run(begin, *self.ends, self.tied(theta))).T.reshape(
            -1, size + 1, states
        )
        path = np.concatenate([begin.T[None], path])[:, 1:, self.problem.rows]
        slopes = (path * self.problem.weights).transpose(0, 2, 1).reshape(-1, size)
        return np.nan_to_num(slopes, nan=0.0, posinf=0.0, neginf=0.0)

    def solve(self) -> Problem:
        """Return the problem with the parameters found."""
        return self.known(self.fitted())

    def fitted(self) -> FloatArray:
        """Return theta of the least squares."""
        found = least_squares(
            self.residual,
            self.theta,
            self.jacobian,
            x_scale="jac",
            max_nfev=300,
            ftol=1e-5,
            xtol=1e-6,
        )
        return np.asarray(found.x)


class SeveralRecordings(SingleShooting):
    """The same of several recordings, each with its time step and its own first state."""

    def __init__(self, problems: list[Problem]):
        self.problem, self.parts = problems[0], [SingleShooting(one) for one in problems]
        states, _, parameters = self.problem.sizes
        shared, own = np.arange(parameters), np.arange(states)
        count = len(problems)
        self.places = [np.append(shared, parameters + states * k + own) for k in range(count)]
        self.theta = np.zeros(parameters + states * count)

    def residual(self, theta: FloatArray) -> FloatArray:
        """Return the scaled errors of all."""
        pairs = zip(self.parts, self.places, strict=True)
        return np.concatenate([part.residual(theta[at]) for part, at in pairs])

    def jacobian(self, theta: FloatArray) -> FloatArray:
        """Return the slopes of the scaled errors of all."""
        rows = []
        for part, at in zip(self.parts, self.places, strict=True):
            slopes = part.jacobian(theta[at])
            rows.append(np.zeros((len(slopes), len(theta))))
            rows[-1][:, at] = slopes
        return np.concatenate(rows)


def free_run(problem: Problem) -> FloatArray:
    """Return the free run (time, state) whose start alone is estimated."""
    shooting = SingleShooting(problem)
    parameters = len(problem.start)

    def of(first):
        return np.concatenate([np.zeros(parameters), first])

    found = least_squares(
        lambda first: shooting.residual(of(first)),
        np.zeros(len(problem.guess)),
        lambda first: shooting.jacobian(of(first))[:, parameters:],
        x_scale="jac",
        max_nfev=50,
    )
    return shooting.path(of(found.x))


class MultipleShooting:
    """IPOPT on a Runge-Kutta step a sample, every sample's state a variable."""

    def __init__(self, problem: Problem):
        self.problem = problem
        states, _, parameters = problem.sizes
        samples = len(problem.inputs)
        theta, path = ca.MX.sym("theta", parameters), ca.MX.sym("x", states, samples)
        x = problem.guess + problem.spread * path
        gaps = self.gaps(x, theta)
        wanted = problem.outputs.T * problem.weights[:, None]
        error = x[list(problem.rows), :] * np.tile(problem.weights[:, None], samples) - wanted
        nlp = {
            "x": ca.veccat(theta, path, *self.others),
            "f": 0.5 * ca.sumsqr(error),
            "g": ca.vec(gaps),
        }
        options = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 300}}
        if not problem.by_hand.exact:
            slope = ca.jacobian(error, nlp["x"])
            weight, prices = ca.MX.sym("weight"), ca.MX.sym("prices", nlp["g"].shape)
            hessian = weight * ca.triu(slope.T @ slope)
            arguments = [nlp["x"], ca.MX.sym("p", 0, 0), weight, prices]
            options["hess_lag"] = ca.Function("hessian", arguments, [hessian])
        self.solver = ca.nlpsol("solver", "ipopt", nlp, options)
        self.begin = np.concatenate([np.zeros(parameters), *self.first_path()])

    others: tuple = ()

    def gaps(self, x, theta):
        """Return what is to be zero, over the spread of the states (equation, sample)."""
        u, samples = self.problem.inputs.T, len(self.problem.inputs) - 1
        every = step(self.problem).map(samples)
        ahead = every(x[:, :-1], u[:, :-1], u[:, 1:], ca.repmat(theta, 1, samples))
        return (ahead - x[:, 1:]) / np.tile(self.problem.spread[:, None], samples)

    def first_path(self) -> list[FloatArray]:
        """Return the scaled states: measured, rates of these, simulated at the start."""
        one = self.problem
        path = SingleShooting(one).path(np.zeros(sum(one.sizes)))
        path = np.where(np.isfinite(path), path, one.guess)
        if not one.by_hand.simulated:
            path[:, one.rows] = one.outputs
            for state, output in one.rates.items():
                path[:, state] = np.gradient(one.outputs[:, output], one.time_step)
        self.scaled = (path - one.guess) / one.spread
        return [self.scaled.ravel()]

    def solve(self) -> Problem:
        """Return the problem with the parameters found."""
        found = self.solver(x0=self.begin, lbg=0, ubg=0)
        return self.problem.fixed(np.array(found["x"]).ravel()[: len(self.problem.start)])


class Collocation(MultipleShooting):
    """IPOPT on Gauss and Legendre's points, two a sample (order 4)."""

    def gaps(self, x, theta):
        """Return what is to be zero, over the spread of the states (equation, sample)."""
        one, degree = self.problem, 2
        states, inputs, parameters = one.sizes
        u, samples, points = (
            one.inputs.T,
            len(one.inputs) - 1,
            ca.collocation_points(degree, "legendre"),
        )
        slopes, ends, _ = ca.collocation_coeff(points)
        first, inside = ca.SX.sym("x", states), ca.SX.sym("z", states, degree)
        now, then = ca.SX.sym("u", inputs), ca.SX.sym("v", inputs)
        moves, rates = ca.SX.sym("theta", parameters), field(one)
        nodes, spread = ca.horzcat(first, inside), ca.DM(one.spread)
        right = [rates(inside[:, j], now, then, points[j], moves) for j in range(degree)]
        wrong = (nodes @ slopes - one.time_step * ca.horzcat(*right)) / ca.repmat(spread, 1, degree)
        element = ca.Function(
            "element", [first, inside, now, then, moves], [ca.vec(wrong), nodes @ ends]
        ).map(samples)
        between = ca.MX.sym("z", states, degree * samples)
        self.others = (between,)
        tiled = np.tile(one.spread[:, None], degree * samples)
        z = np.tile(one.guess[:, None], degree * samples) + tiled * between
        inner, ahead = element(x[:, :-1], z, u[:, :-1], u[:, 1:], ca.repmat(theta, 1, samples))
        return ca.vertcat(inner, (ahead - x[:, 1:]) / tiled[:, :samples])

    def first_path(self) -> list[FloatArray]:
        """Return the scaled states at the samples and on the lines between them."""
        path = super().first_path()
        at = np.array(ca.collocation_points(2, "legendre"))[None, :, None]
        lines = self.scaled[:-1, None] * (1 - at) + self.scaled[1:, None] * at
        return [*path, lines.ravel()]
