"""A held tool whose flap is turned by a finger, and what camera, fingertip and encoders say of it.

The flap is 200 x 80 mm, its hinge lies 6 mm behind the front face and 2 mm behind the back face; a
bracket plate of 120 x 60 mm above it faces the camera. Everything is in closed form: the depth
image is drawn by intersecting rays with rectangles.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.depth_camera import (
    DepthCamera,
    displacement_covariance,
    focal_tilt,
    plane_jacobian,
    seen_covariance,
)
from crossmodal.systems.flap.flap_geometry import CAMERA, FINGER, HOLDER, NAMES
from crossmodal.systems.port_values import (
    DisplacementBelief,
    EndEffectorBelief,
    FingertipContact,
    FlapPlane,
    TactileContact,
    unseen,
)
from crossmodal.systems.sensors.depth_noise import (
    DepthNoiseConfig,
    correlated_noise,
    measure_depth,
    returns,
)

PERIOD = 1.0 / 15.0
INTRINSICS = Intrinsics(
    width=640, height=480, focal_x=577.3, focal_y=577.3, center_x=319.5, center_y=239.5
)
FINGER_BASE, HOLDER_BASE = np.array([0.0, 0.55, 0.0]), np.array([0.0, -0.45, 0.0])
P_WE = np.array([0.0, -0.05, 0.78])


def pose(R: Array, p: Array) -> Array:
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, p
    return X


@dataclass(kw_only=True)
class Tool:
    """The true tool; at theta = 0 the flap hangs down and faces the camera, x."""

    k_W: Array = field(default_factory=lambda: np.array([0.0, -1.0, 0.0]))
    p_WK: Array = field(default_factory=lambda: np.array([0.0, 0.0, 0.6]))
    front: float = 0.006  # From the hinge to the front face, [m].
    back: float = 0.002  # From the hinge to the back face, [m].
    length: float = 0.08  # From the hinge to the free edge, [m].
    width: float = 0.2
    contact: Array = field(default_factory=lambda: np.array([0.08, 0.002, 0.02]))  # t, n, k.

    def frame(self, theta: float) -> Array:
        """R_WF (3, 3) of the flap: columns t (to the free edge), n (front face), k."""
        n0 = np.array([1.0, 0.0, 0.0])
        n0 -= self.k_W * (n0 @ self.k_W)
        n0 /= np.linalg.norm(n0)
        R: Array = se3.so3_exp(self.k_W * theta)
        n = R @ n0
        return np.column_stack([np.cross(n, self.k_W), n, self.k_W])

    def plane(self, theta: float, p_WC: Array) -> tuple[Array, float, bool]:
        """Normal towards the camera at p_WC, d, and whether it is the front face."""
        n = self.frame(theta)[:, 1]
        if n @ (p_WC - self.p_WK) > self.front:
            return n, float(n @ self.p_WK) + self.front, True
        return -n, float(-n @ self.p_WK) + self.back, False

    def contact_point(self, theta: float, offset: Array | None = None) -> Array:
        """Where the finger touches (3,), displaced in the flap by `offset` (t, n, k)."""
        p_F = self.contact if offset is None else self.contact + offset
        return self.p_WK + self.frame(theta) @ p_F

    def rectangles(self, theta: float) -> list[tuple[Array, Array, Array, float, float]]:
        """Centre, two directions and half sizes of each surface."""
        R0, R = self.frame(0.0), self.frame(theta)
        middle = 0.5 * self.length
        flap = [
            (self.p_WK + R @ [middle, offset, 0.0], R[:, 0], R[:, 2], middle, 0.5 * self.width)
            for offset in (self.front, -self.back)
        ]
        bracket = self.p_WK + R0 @ [-0.04, self.front, 0.0]
        return [*flap, (bracket, R0[:, 0], R0[:, 2], 0.03, 0.06)]


def ideal_depth(tool: Tool, theta: float, X_WC: Array) -> Array:
    """Depth image (480, 640) [m], 3 m where there is nothing."""
    u, v = np.meshgrid(np.arange(INTRINSICS.width), np.arange(INTRINSICS.height))
    f, cx, cy = INTRINSICS.focal_x, INTRINSICS.center_x, INTRINSICS.center_y
    rays = np.dstack([(u - cx) / f, (v - cy) / f, np.ones(u.shape)])
    depth = np.full(u.shape, 3.0)
    for centre, a, b, half_a, half_b in tool.rectangles(theta):
        c, ca, cb = X_WC[:3, :3].T @ (centre - X_WC[:3, 3]), X_WC[:3, :3].T @ a, X_WC[:3, :3].T @ b
        normal = np.cross(ca, cb)
        along = rays @ normal
        with np.errstate(divide="ignore"):
            z = (c @ normal) / along
        p = rays * z[..., None] - c
        hit = (np.abs(p @ ca) < half_a) & (np.abs(p @ cb) < half_b) & (z > 0.0) & (z < depth)
        depth[hit] = z[hit]
    return depth


def measured_depth(ideal: Array, rng: np.random.Generator) -> Array:
    """What the depth camera of the house makes of it."""
    c = DepthNoiseConfig()
    depth = ideal.astype(np.float32)
    valid = returns(
        depth, tuple(INTRINSICS.vector()), (c.range_min, c.range_max), c.baseline,
        float(np.cos(c.grazing_angle)),
    )  # fmt: skip
    noise = correlated_noise(rng, depth.shape, c.correlation_window)
    return np.asarray(
        measure_depth(depth, valid, noise, c.depth_step, c.sigma_base, c.sigma_square)
    )


@dataclass(kw_only=True)
class Errors:
    """Standard deviations of the calibration's errors."""

    camera_rotation: float = float(np.deg2rad(0.5))
    camera_translation: float = 0.005
    depth_scale: float = 0.005
    focal_length: float = 0.005
    arm_rotation: float = float(np.deg2rad(0.3))
    arm_translation: float = 0.003
    taxels: float = 0.0005


def _spread(rotation: float, translation: float) -> Array:
    return np.diag(np.repeat([rotation, translation], 3) ** 2)


class Laboratory:
    """One seed of a tool, with true and believed calibrations.

    The camera sees the flap edge-on at `edge_on` [rad]; None for never.
    """

    def __init__(
        self, seed: int, errors: Errors | None = None, edge_on: float | None = np.deg2rad(62.0)
    ) -> None:
        rng = np.random.default_rng([seed, 16])
        e = self.errors = errors or Errors()
        k = np.array([0.0, -1.0, 0.0]) + 0.1 * rng.normal(size=3)
        self.tool = Tool(
            k_W=k / np.linalg.norm(k),
            p_WK=np.array([0.0, 0.0, 0.6]) + 0.02 * rng.normal(size=3),
            front=rng.uniform(0.003, 0.009),
            back=rng.uniform(-0.002, 0.003),
            length=rng.uniform(0.07, 0.1),
        )
        self.tool.contact = np.array(
            [self.tool.length, 0.5 * (self.tool.front - self.tool.back), 0.02]
        )
        elevation = np.deg2rad(60.0) if edge_on is None else edge_on - np.pi / 2
        direction = np.array([np.cos(elevation), 0.0, np.sin(elevation)])
        self.X_WC = se3.looking_at(
            np.array([0.0, 0.0, 0.6]) + 0.9 * direction, np.array([0.0, 0.0, 0.6])
        )
        n = rng.normal(size=19)
        camera = np.concatenate([e.camera_rotation * n[:3], e.camera_translation * n[3:6]])
        self.X_WC_true = self.X_WC @ se3.exp(camera)
        self.depth_scale = 1.0 + e.depth_scale * n[6]
        self.focal_length = e.focal_length * float(np.random.default_rng([seed, 18]).normal())
        arm = np.repeat([e.arm_rotation, e.arm_translation], 3)
        self._finger = se3.exp(arm * n[7:13])  # Of the base, whose axes are the world's.
        self._holder = se3.exp(arm * n[13:19])
        self._taxels = e.taxels * rng.normal(size=3)
        self.rng = rng
        self.camera = DepthCamera(
            intrinsics=INTRINSICS,
            X_WC=self.X_WC,
            pose_covariance=_spread(e.camera_rotation, e.camera_translation),
            depth_scale_std=e.depth_scale,
            focal_length_std=e.focal_length,
        )
        self._walk = np.zeros(3)

    def _aside(self, p_W: Array) -> Array:
        """From the camera's optical axis to a point."""
        ray, z = p_W - self.X_WC[:3, 3], self.X_WC[:3, 2]
        return np.asarray(ray - z * (z @ ray))

    def theta(self, t: float) -> float:
        """Two seconds of rest, then 0.08 rad/s up to 125 deg."""
        return float(np.clip(0.08 * (t - 2.0), 0.0, np.deg2rad(125.0)))

    def plane(self, theta: float, hidden: float = np.deg2rad(20.0)) -> FlapPlane:
        """The measured plane, hidden within so much of edge-on: noise as of a plane fit."""
        p_WC = self.X_WC_true[:3, 3]
        n, d, _ = self.tool.plane(theta, p_WC)
        R = self.tool.frame(theta)
        p_WF = self.tool.p_WK + R @ [0.5 * self.tool.length, 0.0, 0.0]
        p_WF += n * (d - n @ p_WF)
        ray = (p_WC - p_WF) / np.linalg.norm(p_WC - p_WF)
        if n @ ray < np.sin(hidden):
            return unseen("grazing view")
        sigma = 0.0017 * np.sqrt(n @ ray)
        patches = max(np.sqrt(self.tool.length * self.tool.width) / 0.014, 1.0)
        spread = np.array([self.tool.length, self.tool.width]) / np.sqrt(12.0)
        std = sigma / patches / np.array([spread[0], spread[1], 1.0])
        e = std * self.rng.normal(size=3)
        n_noisy = n + R[:, 0] * e[0] + R[:, 2] * e[1]
        n_noisy /= np.linalg.norm(n_noisy)
        J = np.zeros((4, 3))
        J[:3, 0], J[:3, 1] = R[:, 0], R[:, 2]
        J[3] = J[:3].T @ p_WF + np.array([0.0, 0.0, 1.0])
        # What the believed camera makes of it.
        X = self.X_WC @ se3.inverse(self.X_WC_true)
        scaled = p_WC + self.depth_scale * (p_WF + n * e[2] - p_WC)
        scaled += self.focal_length * self._aside(p_WF)
        tilted = n_noisy + self.focal_length * focal_tilt(self.camera, n_noisy)
        seen_n = X[:3, :3] @ tilted / np.linalg.norm(tilted)
        seen_p = X[:3, :3] @ scaled + X[:3, 3]
        J_seen = np.zeros((4, 3))
        J_seen[:3] = X[:3, :3] @ J[:3]
        J_seen[3] = J_seen[:3].T @ seen_p + np.array([0.0, 0.0, 1.0])
        common = plane_jacobian(seen_n, float(seen_n @ seen_p), seen_p)
        common = common @ seen_covariance(self.camera, seen_p) @ common.T
        return FlapPlane(
            seen=True, n_W=seen_n, d=float(seen_n @ seen_p),
            covariance=J_seen @ np.diag(std**2) @ J_seen.T,
            common_covariance=common, p_WF=seen_p, points=2000,
        )  # fmt: skip

    def contact(self, theta: float, rate: float) -> FingertipContact:
        """What the fingertip says; the contact wanders on the flap's edge."""
        step = np.sqrt(2.0 * PERIOD / 3.0) * self.rng.normal(size=3)
        self._walk += -self._walk * PERIOD / 3.0 + step * np.array([0.0001, 0.001, 0.002])
        R = self.tool.frame(theta)
        true = self.tool.contact_point(theta, self._walk)
        self.true_contact = true
        white, white_v = 0.0002, 0.0005
        measured = true + R @ self._taxels + white * self.rng.normal(size=3)
        base = FINGER_BASE
        # The believed arm is where the base is believed to be.
        X = pose(np.eye(3), base) @ se3.inverse(self._finger) @ se3.inverse(pose(np.eye(3), base))
        measured = X[:3, :3] @ measured + X[:3, 3]
        velocity = X[:3, :3] @ np.cross(rate * self.tool.k_W, true - self.tool.p_WK)
        velocity = velocity + white_v * self.rng.normal(size=3)
        e = self.errors
        # Common error of S in W about its origin, which is taken to be at the contact.
        J = np.eye(6)
        J[3:, :3] = -se3.skew(measured - base)
        common = J @ _spread(e.arm_rotation, e.arm_translation) @ J.T
        n_S = np.array([0.0, 1.0, 0.0])
        contact = TactileContact(
            touching=True, p_SC=np.zeros(3), covariance=np.eye(3) * white**2, n_S=n_S, f_S=0.5 * n_S
        )
        noise = np.eye(3) * white**2
        R_WS = np.column_stack([R[:, 1], -R[:, 0], R[:, 2]])  # Travel, pad to the hinge, finger.
        R6 = np.kron(np.eye(2), R_WS)
        return FingertipContact(
            X_WS=pose(R_WS, measured), covariance=R6.T @ common @ R6,
            white_covariance=np.zeros((6, 6)),
            contact=contact, p_WC=measured,
            p_WC_covariance=common[3:, 3:] + noise + np.eye(3) * e.taxels**2,
            p_WC_white_covariance=noise, v_WC=velocity, v_WC_covariance=np.eye(3) * white_v**2,
        )  # fmt: skip

    def displacements(self, registered: bool = False) -> DisplacementBelief:
        """What is known of them: as declared, or once camera and arms were registered.

        The registration says by how much each arm is displaced against the camera, within 0.5 mm
        and 0.1 deg.
        """
        e, p_WQ = self.errors, P_WE
        covariance, true = np.zeros((18, 18)), np.zeros(18)
        belief = DisplacementBelief(names=NAMES, p_WQ=p_WQ, mean=true, covariance=covariance)
        arm = _spread(e.arm_rotation, e.arm_translation)
        blocks = {CAMERA: seen_covariance(self.camera, p_WQ)}
        moved = {CAMERA: self.X_WC @ se3.inverse(self.X_WC_true)}
        for name, base, error in (
            (HOLDER, HOLDER_BASE, self._holder), (FINGER, FINGER_BASE, self._finger),
        ):  # fmt: skip
            X_WBase = pose(np.eye(3), base)
            blocks[name] = displacement_covariance(X_WBase, arm, p_WQ)
            moved[name] = X_WBase @ se3.inverse(error) @ se3.inverse(X_WBase)
        for name in NAMES:
            part, X = belief.part(name), moved[name]
            covariance[part, part] = blocks[name]
            true[part] = np.append(se3.so3_log(X[:3, :3]), X[:3, :3] @ p_WQ + X[:3, 3] - p_WQ)
        true[3:6] += (self.depth_scale - 1.0) * (p_WQ - self.X_WC[:3, 3])
        true[3:6] += self.focal_length * self._aside(p_WQ)
        if not registered:
            return replace(belief, mean=np.zeros(18))
        H = np.hstack([np.tile(-np.eye(6), (2, 1)), np.eye(12)])
        R = np.diag(np.tile(np.repeat([np.deg2rad(0.1), 5e-4], 3), 2) ** 2)
        noise = np.random.default_rng(17).multivariate_normal(np.zeros(12), R)
        K = covariance @ H.T @ np.linalg.inv(H @ covariance @ H.T + R)
        return replace(
            belief, mean=K @ (H @ true + noise), covariance=covariance - K @ H @ covariance
        )

    def end_effector(self) -> EndEffectorBelief:
        """The holder's end-effector; P_WE is the true one."""
        base = pose(np.eye(3), HOLDER_BASE)
        X = base @ se3.inverse(self._holder) @ se3.inverse(base)
        p = X[:3, :3] @ P_WE + X[:3, 3]
        e = self.errors
        J = np.eye(6)
        J[3:, :3] = -se3.skew(p - HOLDER_BASE)
        scale = np.repeat([e.arm_rotation, e.arm_translation], 3)
        B = X[:3, :3].T
        bias = np.block([[B, np.zeros((3, 3))], [np.zeros((3, 3)), B]]) @ J * scale
        covariance = 1e-10 * np.eye(12)
        covariance[:6, :6] += bias @ bias.T
        return EndEffectorBelief(
            X=pose(X[:3, :3], p), V=np.zeros(6), covariance=covariance, bias_jacobian=bias
        )
