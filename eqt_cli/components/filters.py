"""Filters with a covariance: the error-state, the equivariant and the invariant one."""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from eqt_cli.base.arrays import Array, apply_matrix, less, sqrt, transpose, where
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import POSE, VELOCITY, Scale
from eqt_cli.components.estimators import Deviations, Estimate, Estimator, Fix, Schedule, symmetric
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.vehicle_parts import Numbers, check_deviations, drawn
from eqt_cli.numbers.leaves import with_fields

# Kalman filter for the errors log(Q̂⁻¹Q) of the pose and b − b̂ of the bias, on any group ---------
#
# The V of Q̇ = Q V^ is measured as V_m = V + b + n, with a bias b that walks; a fix is Q exp(n), or
# parts of it. With V̂ = V_m − b̂, ε̇ = −ad_V̂ ε − b̃ − n to first order. This module must not know
# how a kind applies a correction.


DEVIATIONS = ("pose_std", "velocity_std", "bias_walk", "initial_pose_std", "initial_bias_std")
"""Options that are standard deviations."""


@dataclass(frozen=True)
class ErrorStateFilter(Estimator):
    """The base class of filters with a covariance, which differ in how they apply a correction.

    A step of h seconds is Q̂ ← Q̂ exp(x) with x = ½h(V_k − n̂ + V_k+1) − hb̂ of two measured
    velocities. The noise n of one counts in both steps beside it, and Σ has its rows:
    ε ← Ad_exp(x)⁻¹ ε − J(−x) h(b̃ + ½(n − n̂) + ½(n' + w)), b̃ ← b̃ + w, n ← n', with n' of deviation
    σ_v, and w of √h σ_b. A fix is taken coordinate by coordinate, in Joseph form.

    Attributes
    ----------
    pose_std
        Standard deviation of a fix, in the coordinates of the algebra; one number, or a list.
        Default: the deviation of the noise of `sensors.pose`.
    velocity_std
        Standard deviation of one measurement of the velocity. Default: the deviation of the noise
        of `sensors.velocity`.
    bias_walk
        Standard deviation of the drift of the bias after one second. Default: the `walk` of the
        bias of `sensors.velocity`.
    initial_pose_std
        Standard deviation of log(Q̂⁻¹Q) at the start; each run then draws its Q̂ with it. Default:
        Q̂ starts at the first fix, with the deviation of a fix.
    initial_bias_std
        Standard deviation of the bias at the start. Default: the root mean square of the `value` of
        the bias.
    """

    vectors: ClassVar[tuple[str, ...]] = (*DEVIATIONS, "initial_error")
    has_covariance: ClassVar[bool] = True

    pose_std: Annotated[Numbers | None, Scale("assumed deviation of a fix", POSE)] = None
    velocity_std: Annotated[Numbers | None, Scale("assumed deviation of a velocity", VELOCITY)] = (
        None
    )
    bias_walk: Annotated[Numbers | None, Scale("assumed drift of the bias")] = None
    initial_pose_std: Annotated[Numbers | None, Scale("initial deviation of the pose", POSE)] = None
    initial_bias_std: Annotated[
        Numbers | None, Scale("initial deviation of the bias", VELOCITY)
    ] = None

    # For kinds to define.

    @abstractmethod
    def output(self, G: MatrixLieGroup, residual: Array) -> Array:
        """Return H of log(Q̂⁻¹Q_m) = H ε + n_p, ``(..., m, m)``; the left side is measured."""

    @abstractmethod
    def moved(self, G: MatrixLieGroup, now: Estimate, by: Array) -> Estimate:
        """Return the estimate moved by a correction of (ε, b̃, n), ``(..., 3m)``."""

    # Options.

    @property
    def varies(self) -> bool:
        """Whether numbers, or the start of the estimate, differ from run to run."""
        return super().varies or (self.initial_pose_std is not None and self.initial_error is None)

    def completed(self, G: MatrixLieGroup, known: Deviations) -> Self:
        """Return the filter with the deviations of the sensors where none are given."""
        said = {
            "pose_std": known.pose,
            "velocity_std": known.velocity,
            "bias_walk": known.walk,
            "initial_bias_std": known.bias,
        }
        left_out = [name for name in said if getattr(self, name) is None]
        return with_fields(self, **{name: said[name].tolist() for name in left_out})

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the filter of one run, with its start where that is drawn."""
        drawn = super().of_run(G, random)
        if self.initial_pose_std is None or self.initial_error is not None:
            return drawn
        normal = np.zeros(G.dimension) if random is None else random.standard_normal(G.dimension)
        return with_fields(drawn, initial_error=_of(drawn).initial_pose_std * normal)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note negative or too many deviations, and a start without a deviation."""
        for name in DEVIATIONS:
            if (value := getattr(self, name)) is not None:
                check_deviations(value, G, problems.at(name))
        super().check(G, problems)
        if self.initial_error is not None and self.initial_pose_std is None:
            problems.at("initial_pose_std").add(
                "missing; with initial_error, the filter must be told how large that may be"
            )

    def check_sensors(self, schedule: Schedule, known: Deviations, problems: Problems) -> None:
        """Note deviations of 0, parts without a known start, and a bias that no fix can tell."""
        G, done = schedule.G, self.completed(schedule.G, known)
        values = {
            name: np.broadcast_to(np.array(drawn(value, None), dtype=float), G.dimension)
            for name in DEVIATIONS
            if (value := getattr(done, name)) is not None
        }
        measured = {axis: axis in schedule.axes for axis in range(G.dimension)}
        for part in G.parts:
            axes = list(range(G.dimension)[part.axes])
            fixed = all(measured[axis] for axis in axes)
            positive = ["velocity_std", *["pose_std"] * fixed, "initial_pose_std"]
            for name in positive:
                if name in values and (values[name][axes] <= 0).any():
                    problems.at(name).add(self._no_deviation(name, part.name))
            if fixed:
                continue
            biased = (values["initial_bias_std"][axes] > 0) | (values["bias_walk"][axes] > 0)
            if biased.any():
                problems.add(
                    f"the bias of the {part.name} cannot be told: nothing measures the "
                    f"{part.name}; add an entry for it to sensors.pose, or set "
                    "initial_bias_std and bias_walk to 0 there"
                )
            elif "initial_pose_std" not in values:
                problems.at("initial_pose_std").add(
                    f"missing; nothing measures the {part.name}, so that no fix says where its "
                    "estimate starts"
                )

    def _no_deviation(self, name: str, part: str) -> str:
        """Return the message for a deviation of 0."""
        if getattr(self, name) is not None:
            return f"expected deviations greater than 0 for the {part}, got 0"
        signal = name.partition("_")[0]
        return (
            f"sensors.{signal} has no noise of the {part}, whose deviation is the default; give "
            "deviations greater than 0"
        )

    # The filter.

    def first(self, G: MatrixLieGroup, pose: Array) -> Estimate:
        """Return the estimate at the start, at a pose, with its covariance."""
        bias = np.zeros_like(pose, shape=(*pose.shape[:-2], G.dimension))
        options: Any = self
        std = options.pose_std if options.initial_pose_std is None else options.initial_pose_std
        deviations = np.concatenate(
            [each + bias for each in (std, options.initial_bias_std, options.velocity_std)], axis=-1
        )
        return Estimate(pose, bias, _diagonal(deviations * deviations), bias)

    def predicted(
        self, schedule: Schedule, now: Estimate, velocity: Array, duration: Array
    ) -> Estimate:
        """Return the estimate with Q̂ exp(hV̂), and Σ after the step that the class describes.

        Where no velocity is known at the end, the last one counts alone and n stays, less the drift
        of a bias that is not known yet.
        """
        G, m, options, S = schedule.G, schedule.G.dimension, _of(self), now.covariance
        bias, last = slice(m, 2 * m), slice(2 * m, 3 * m)
        x = duration * (velocity - now.bias)
        step = G.exp(x)
        A, B = G.Ad_matrix(G.inverse(step)), -G.jacobian(-x)
        end, held = duration * now.share, where(less(0.0, now.share), 0.0, 1.0)
        start = duration - end
        noise = options.velocity_std * options.velocity_std
        walk = now.drift * duration * options.bias_walk * options.bias_walk
        through = duration[..., None] * S[..., bias, :] + start[..., None] * S[..., last, :]
        top = A @ S[..., :m, :] + B @ through
        across = duration[..., None] * top[..., bias] + start[..., None, :] * top[..., last]
        across = across + B * (end * end * (noise + walk))[..., None, :]
        covariance = np.zeros_like(S)
        covariance[..., :m, :m] = top[..., :m] @ transpose(A) + across @ transpose(B)
        covariance[..., :m, bias] = top[..., bias] + B * (end * walk)[..., None, :]
        covariance[..., bias, bias] = S[..., bias, bias] + _diagonal(walk)
        coupling = S[..., last] * held[..., None, :]
        covariance[..., :m, last] = (
            held[..., None, :] * top[..., last] + B * (end * noise)[..., None, :]
        )
        covariance[..., bias, last] = coupling[..., bias, :] - _diagonal(held * walk)
        new = (1.0 - held) * noise + held * walk
        covariance[..., last, last] = held[..., None] * coupling[..., last, :] + _diagonal(new)
        changed = {"noise": held * now.noise, "covariance": mirrored(covariance)}
        return now._replace(pose=now.pose @ step, **changed)

    def corrected(self, schedule: Schedule, now: Estimate, fix: Fix) -> tuple[Estimate, Array]:
        """Return the estimate corrected coordinate by coordinate, and its whitened innovations.

        K = Σhᵀ/(hΣhᵀ + σ²), and in Joseph form Σ ← (I − Kh)Σ(I − Kh)ᵀ + σ²KKᵀ.
        """
        G, m, options = schedule.G, schedule.G.dimension, _of(self)
        residual = G.log(G.inverse(now.pose) @ fix.pose)
        H, S = self.output(G, residual), now.covariance
        by = 0.0 * np.concatenate([now.bias] * 3, axis=-1)
        innovations = 0.0 * now.bias
        for axis in schedule.axes:
            h = H[..., axis, :]
            seen = (S[..., :m] @ h[..., None])[..., 0]
            variance = (options.pose_std * options.pose_std)[..., axis, None]
            total = (h * seen[..., :m]).sum(axis=-1)[..., None] + variance
            K = fix.arrived[..., axis, None] * seen / total
            unexpected = residual[..., axis, None] - (h * by[..., :m]).sum(axis=-1)[..., None]
            by = by + K * unexpected
            left = S - K[..., :, None] * seen[..., None, :]
            back = variance * K - (left[..., :m] @ h[..., None])[..., 0]
            S = mirrored(left + back[..., :, None] * K[..., None, :])
            innovations[..., axis] = (unexpected / sqrt(total))[..., 0]
        return self.moved(G, now._replace(covariance=S), by), innovations


def _of(estimator: ErrorStateFilter) -> Any:
    """Return the filter, typed as in a run, with arrays for its options."""
    return estimator


def _diagonal(entries: Array) -> Array:
    """Return the diagonal matrix with these entries, ``(..., n) -> (..., n, n)``."""
    return entries[..., :, None] * np.eye(entries.shape[-1])


def mirrored(matrix: Array) -> Array:
    """Return the symmetric matrix with the entries of this one on and above the diagonal."""
    n = matrix.shape[-1]
    rows, columns = np.triu_indices(n)
    return symmetric(matrix[..., rows, columns], n)


@dataclass(frozen=True)
class Eqf(ErrorStateFilter):
    """Equivariant filter whose symmetry is the tangent group G ⋉ g.

    Its error is (QQ̂⁻¹, Ad_Q̂ b̃) = exp(ε_r, ε_b) in that group, so that ε_r = Ad_Q̂ ε and
    ε_b = Ad_Q̂ b̃ to first order: ε̇_r = −ε_b, ε̇_b = ad_{Ad_Q̂ V̂} ε_b. A correction is the exponential
    of the tangent group, from the left, and Σ stays as it is in these coordinates. A fix is read to
    third order, r = (I − ½ad_r) ε + n. Here Σ is kept in the body frame, by Ad_Q̂⁻¹, where the same
    Φ moves it.

    Fornasier, Ng, Brommer, Böhm, Mahony, Weiss, IEEE Robot. Autom. Lett. 7 (2022) 12118 (Overcoming
    Bias); Fornasier, Ge, van Goor, Mahony, Weiss, Automatica 182 (2025) 112495 (Equivariant
    Symmetries for Inertial Navigation Systems).
    """

    name: ClassVar[str] = "eqf"

    def output(self, G: MatrixLieGroup, residual: Array) -> Array:
        """Return I − ½ad_r."""
        return np.eye(G.dimension) - G.ad_matrix(residual) / 2

    def moved(self, G: MatrixLieGroup, now: Estimate, by: Array) -> Estimate:
        """Return Q̂ exp(δ_ε), b̂ + J(−δ_ε) δ_b, n̂ + δ_n, and Σ transported by Ad_{exp(−δ_ε)}.

        The noise n belongs to the sensor, and is not transported.
        """
        m, covariance = G.dimension, now.covariance
        step = G.exp(by[..., :m])
        carry = G.Ad_matrix(G.inverse(step))
        for _ in ("rows", "columns"):
            S = covariance.copy()
            S[..., :m, :] = carry @ covariance[..., :m, :]
            S[..., m : 2 * m, :] = carry @ covariance[..., m : 2 * m, :]
            covariance = transpose(S)
        return Estimate(
            now.pose @ step,
            now.bias + apply_matrix(G.jacobian(-by[..., :m]), by[..., m : 2 * m]),
            mirrored(covariance),
            now.noise + by[..., 2 * m :],
            now.age,
        )


@dataclass(frozen=True)
class Invariant(ErrorStateFilter):
    """Left-invariant extended Kalman filter with a bias of the velocity.

    Barrau and Bonnabel, IEEE Trans. Autom. Control 62 (2017) 1797, with the bias beside the pose:
    the residual of a fix is ε + n, and a correction δ gives Q̂ exp(δ_ε) and b̂ + δ_b.
    """

    name: ClassVar[str] = "invariant"

    def output(self, G: MatrixLieGroup, residual: Array) -> Array:
        """Return I."""
        return np.eye(G.dimension) + 0.0 * residual[..., None]

    def moved(self, G: MatrixLieGroup, now: Estimate, by: Array) -> Estimate:
        """Return Q̂ exp(δ_ε), b̂ + δ_b, n̂ + δ_n."""
        m, pose = G.dimension, now.pose @ G.exp(by[..., : G.dimension])
        bias, noise = now.bias + by[..., m : 2 * m], now.noise + by[..., 2 * m :]
        return now._replace(pose=pose, bias=bias, noise=noise)
