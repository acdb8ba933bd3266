"""A four-bar under gravity in other engines, each as a function that gives the crank's angle and the energy over time.

The mechanism: bars of `LENGTHS` (crank, coupler, rocker, ground), the masses and inertias of `MASSES` and `INERTIAS`,
centres of mass in the middle, but that of the coupler at `CENTRE` in its own axes.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np

LENGTHS = 0.04, 0.12, 0.08, 0.1
MASSES = 0.2, 0.6, 0.4
INERTIAS = 2.6666666666666667e-05, 0.0009, 0.00021333333333333333
CENTRE = 0.05, 0.02
G = 9.81
THETA, OMEGA = np.pi / 2, 10.0


def places(theta):
    """Points A and B of the open four-bar at an angle of the crank, by the meeting of two circles."""
    crank, coupler, rocker, ground = LENGTHS
    a = crank * jnp.stack([jnp.cos(theta), jnp.sin(theta)])
    far = jnp.array([ground, 0.0]) - a
    square = far @ far
    along = 0.5 * (coupler**2 - rocker**2 + square) / square
    across = jnp.sqrt(coupler**2 / square - along**2)
    return a, a + along * far + across * jnp.stack([-far[1], far[0]])


def centres(theta):
    """Centres of mass and directions of the three bars, ``(3, 2)`` twice."""
    a, b = places(theta)
    d = jnp.array([LENGTHS[3], 0.0])
    u = (b - a) / LENGTHS[1]
    middle = a + CENTRE[0] * u + CENTRE[1] * jnp.stack([-u[1], u[0]])
    return jnp.stack([a / 2, middle, (b + d) / 2]), jnp.stack([a / LENGTHS[0], u, (b - d) / LENGTHS[2]])


def inertia(theta):
    """Inertia of the whole four-bar felt at its crank."""
    (dc, du) = jax.jvp(centres, (theta,), (jnp.ones_like(theta),))[1]
    return jnp.array(MASSES) @ jnp.sum(dc**2, axis=1) + jnp.array(INERTIAS) @ jnp.sum(du**2, axis=1)


def potential(theta):
    """Potential energy of gravity along -y."""
    return G * jnp.array(MASSES) @ centres(theta)[0][:, 1]


@jax.jit
@jax.vmap
def energy(theta, omega):
    """Energy at many angles and speeds of the crank."""
    return 0.5 * inertia(theta) * omega**2 + potential(theta)


def by_hand(t, tolerance):
    """diffrax' Dopri8 on the crank's angle alone, inertia and its slope written for this mechanism."""
    import diffrax

    def field(_, y, args):
        slope = jax.grad(inertia)(y[0])
        return jnp.stack([y[1], -(0.5 * slope * y[1] ** 2 + jax.grad(potential)(y[0])) / inertia(y[0])])

    @jax.jit
    def solve(omega):
        found = diffrax.diffeqsolve(
            diffrax.ODETerm(field),
            diffrax.Dopri8(),
            t[0],
            t[-1],
            None,
            jnp.stack([jnp.asarray(THETA), omega]),
            saveat=diffrax.SaveAt(ts=jnp.asarray(t)),
            stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=0.01 * tolerance),
            max_steps=1_000_000,
        )
        return found.ys

    return lambda omega: np.asarray(solve(jnp.asarray(omega))).T


def natural_by_hand(t, tolerance):
    """diffrax' Dopri8 on natural coordinates written for this mechanism: x and y of A and B, index 1, no projection."""
    import diffrax

    base = [(None, 0), (0, 1), (1, None)]
    ground = jnp.array([LENGTHS[3], 0.0])
    mass, weight = np.zeros((4, 4)), np.zeros(4)
    for (i, j), m, polar, length, own in zip(
        base, MASSES, INERTIAS, LENGTHS[:3], [(0.02, 0.0), CENTRE, (0.04, 0.0)], strict=True
    ):
        c, e = np.array(own) / length
        # The place c d + e d⊥ of a bar from its first point, as a matrix on both of its points.
        turn = np.array([[c, -e], [e, c]])
        reach = np.hstack([np.eye(2) - turn, turn])
        second = polar / length**2 * np.kron(np.array([[1, -1], [-1, 1]]), np.eye(2))
        whole = m * reach.T @ reach + second
        at = [*(range(2 * i, 2 * i + 2) if i is not None else (-1, -1))]
        at += [*(range(2 * j, 2 * j + 2) if j is not None else (-1, -1))]
        for p, x in enumerate(at):
            if x >= 0:
                weight[x] -= m * G * reach[1, p]
                for k, y in enumerate(at):
                    if y >= 0:
                        mass[x, y] += whole[p, k]
    mass, weight = jnp.asarray(mass), jnp.asarray(weight)

    def rows(q):
        a, b = q[:2], q[2:]
        return 0.5 * jnp.stack([a @ a, (b - a) @ (b - a), (b - ground) @ (b - ground)])

    def field(_, y, args):
        q, v = y
        jac = jax.jacfwd(rows)(q)
        va, vb = v[:2], v[2:]
        bias = jnp.stack([va @ va, (vb - va) @ (vb - va), vb @ vb])
        left = jnp.block([[mass, jac.T], [jac, jnp.zeros((3, 3))]])
        return v, jnp.linalg.solve(left, jnp.concatenate([weight, -bias]))[:4]

    a, b = places(jnp.asarray(THETA))
    da, db = jax.jvp(places, (jnp.asarray(THETA),), (jnp.ones(()),))[1]

    @jax.jit
    def solve(omega):
        start = jnp.concatenate([a, b]), omega * jnp.concatenate([da, db])
        return diffrax.diffeqsolve(
            diffrax.ODETerm(field),
            diffrax.Dopri8(),
            t[0],
            t[-1],
            None,
            start,
            saveat=diffrax.SaveAt(ts=jnp.asarray(t)),
            stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=0.01 * tolerance),
            max_steps=1_000_000,
        ).ys

    def run(omega):
        q, v = (np.asarray(x) for x in solve(jnp.asarray(omega)))
        return angle(q[:, 0], q[:, 1]), (q[:, 0] * v[:, 1] - q[:, 1] * v[:, 0]) / LENGTHS[0] ** 2

    return run


def angle(x, y):
    """The crank's angle without jumps, beginning at its start."""
    return np.unwrap(np.arctan2(y, x))


@functools.cache
def _start():
    """Angles of the bars at the start, and their rates at unit speed of the crank."""

    def angles(theta):
        u = centres(theta)[1]
        return jnp.arctan2(u[:, 1], u[:, 0])

    value, rate = jax.jvp(angles, (jnp.asarray(THETA),), (jnp.ones(()),))
    return np.asarray(value), np.asarray(rate), [np.asarray(x) for x in places(jnp.asarray(THETA))]


def pinocchio(t, step):
    """Pinocchio's constrained dynamics of two open chains closed at B, Runge-Kutta steps in Python."""
    import pinocchio as pin

    model = pin.Model()
    _, _, (_a, _b) = _start()
    own = [(0.02, 0.0), CENTRE, (0.04, 0.0)]
    shift = [(0, 0.0), (1, LENGTHS[0]), (0, LENGTHS[3])]
    ids = []
    for (parent, x), m, polar, com, name in zip(
        shift, MASSES, INERTIAS, own, ("crank", "coupler", "rocker"), strict=True
    ):
        joint = model.addJoint(
            ids[0] if parent else 0, pin.JointModelRZ(), pin.SE3(np.eye(3), np.array([x, 0.0, 0.0])), name
        )
        inertia_ = pin.Inertia(m, np.array([*com, 0.0]), np.diag([1e-9, 1e-9, polar]))
        model.appendBodyToJoint(joint, inertia_, pin.SE3.Identity())
        ids.append(joint)
    model.gravity = pin.Motion(np.array([0, -G, 0.0]), np.zeros(3))
    ends = [pin.SE3(np.eye(3), np.array([length, 0.0, 0.0])) for length in LENGTHS[1:3]]
    contact = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, ids[1], ends[0], ids[2], ends[1])
    contact.setBaumgarteCorrectorParameters(pin.BaumgarteCorrectorParameters(100.0, 20.0))
    data = model.createData()
    models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    models.append(contact)
    datas.append(contact.createData())
    pin.initConstraintDynamics(model, data, models, datas)
    proximal = pin.ProximalSettings(1e-12, 1e-10, 4)  # the row across the plane is redundant
    value, rate, _ = _start()
    fixed = np.array([value[0], value[1] - value[0], value[2]])
    unit = np.array([rate[0], rate[1] - rate[0], rate[2]])
    none = np.zeros(3)

    def accelerate(q, v):
        return pin.constraintDynamics(model, data, q, v, none, models, datas, proximal).copy()

    def run(omega):
        q, v, n = fixed.copy(), omega * unit, round((t[1] - t[0]) / step)
        out = [(q[0], v[0])]
        for _ in range(len(t) - 1):
            for _ in range(n):
                a1 = accelerate(q, v)
                v2 = v + 0.5 * step * a1
                a2 = accelerate(q + 0.5 * step * v, v2)
                v3 = v + 0.5 * step * a2
                a3 = accelerate(q + 0.5 * step * v2, v3)
                v4 = v + step * a3
                a4 = accelerate(q + step * v3, v4)
                q = q + step / 6 * (v + 2 * (v2 + v3) + v4)
                v = v + step / 6 * (a1 + 2 * (a2 + a3) + a4)
            out.append((q[0], v[0]))
        return np.array(out).T

    return run


def mujoco(t, step):
    """MuJoCo: hinges, the loop closed by a soft equality, its Runge-Kutta integrator."""
    import mujoco as mj

    value, rate, _ = _start()
    c, k, r, g = LENGTHS
    xml = f"""<mujoco><option timestep="{step}" integrator="RK4" gravity="0 {-G} 0" solver="Newton" tolerance="1e-14"
      iterations="50"><flag contact="disable"/></option><compiler angle="radian" inertiafromgeom="false"/>
    <worldbody>
      <body name="crank"><joint name="a" type="hinge" axis="0 0 1"/>
        <inertial pos="0.02 0 0" mass="{MASSES[0]}" diaginertia="1e-9 {INERTIAS[0]} {INERTIAS[0]}"/>
        <body name="coupler" pos="{c} 0 0"><joint name="b" type="hinge" axis="0 0 1"/>
          <inertial pos="{CENTRE[0]} {CENTRE[1]} 0" mass="{MASSES[1]}" diaginertia="{INERTIAS[1] / 2} {INERTIAS[1] / 2} {INERTIAS[1]}"/>
          <site name="p" pos="{k} 0 0"/></body></body>
      <body name="rocker" pos="{g} 0 0"><joint name="d" type="hinge" axis="0 0 1"/>
        <inertial pos="0.04 0 0" mass="{MASSES[2]}" diaginertia="1e-9 {INERTIAS[2]} {INERTIAS[2]}"/>
        <site name="q" pos="{r} 0 0"/></body>
    </worldbody>
    <equality><connect site1="p" site2="q" solref="{2 * step} 1" solimp="0.9999 0.9999 0.001"/></equality>
    </mujoco>"""  # noqa: E501
    model = mj.MjModel.from_xml_string(xml)
    data = mj.MjData(model)

    def run(omega):
        mj.mj_resetData(model, data)
        data.qpos[:] = value[0], value[1] - value[0], value[2]
        data.qvel[:] = omega * np.array([rate[0], rate[1] - rate[0], rate[2]])
        n, out = round((t[1] - t[0]) / step), [(value[0], omega)]
        for _ in range(len(t) - 1):
            mj.mj_step(model, data, n)
            out.append((data.qpos[0], data.qvel[0]))
        return np.array(out).T

    return run


def exudyn(t, step):
    """Exudyn: three rigid bodies, four revolute joints, its implicit trapezoidal rule of index 2."""
    import exudyn as exu
    from exudyn.utilities import (
        MarkerBodyPosition,
        NodeRigidBody2D,
        ObjectGround,
        ObjectJointRevolute2D,
        ObjectRigidBody2D,
        SensorNode,
    )

    value, rate, (_a, _b) = _start()
    middles, speeds = jax.jvp(centres, (jnp.asarray(THETA),), (jnp.ones(()),))
    own = np.array([(0.02, 0.0), CENTRE, (0.04, 0.0)])

    def run(omega):
        container = exu.SystemContainer()
        mbs = container.AddSystem()
        base = mbs.AddObject(ObjectGround(referencePosition=[0, 0, 0]))
        marker = [mbs.AddMarker(MarkerBodyPosition(bodyNumber=base, localPosition=[x, 0, 0])) for x in (0, LENGTHS[3])]
        ends = []
        for i in range(3):
            node = mbs.AddNode(
                NodeRigidBody2D(
                    referenceCoordinates=[*np.asarray(middles[0][i]), value[i]],
                    initialVelocities=[*(omega * np.asarray(speeds[0][i])), omega * rate[i]],
                )
            )
            body = mbs.AddObject(ObjectRigidBody2D(physicsMass=MASSES[i], physicsInertia=INERTIAS[i], nodeNumber=node))
            mbs.AddLoad(
                exu.itemInterface.LoadForceVector(
                    markerNumber=mbs.AddMarker(MarkerBodyPosition(bodyNumber=body)),
                    loadVector=[0, -MASSES[i] * G, 0],
                )
            )
            pair = [
                mbs.AddMarker(MarkerBodyPosition(bodyNumber=body, localPosition=[x - own[i][0], -own[i][1], 0]))
                for x in (0, LENGTHS[i])
            ]
            ends.append(pair)
            if i == 0:
                sensors = [
                    mbs.AddSensor(SensorNode(nodeNumber=node, storeInternal=True, writeToFile=False,
                                             outputVariableType=kind))
                    for kind in (exu.OutputVariableType.Coordinates, exu.OutputVariableType.Coordinates_t)
                ]  # fmt: skip
        for pair in (
            [marker[0], ends[0][0]], [ends[0][1], ends[1][0]], [ends[1][1], ends[2][1]], [marker[1], ends[2][0]],
        ):  # fmt: skip
            mbs.AddObject(ObjectJointRevolute2D(markerNumbers=pair))
        mbs.Assemble()
        settings = exu.SimulationSettings()
        settings.timeIntegration.numberOfSteps = round((t[-1] - t[0]) / step)
        settings.timeIntegration.endTime = float(t[-1])
        settings.timeIntegration.verboseMode = 0
        settings.displayStatistics = False
        settings.solutionSettings.writeSolutionToFile = False
        settings.solutionSettings.sensorsWritePeriod = float(t[1] - t[0])
        settings.timeIntegration.newton.useModifiedNewton = True
        settings.timeIntegration.newton.relativeTolerance = 1e-11
        settings.timeIntegration.generalizedAlpha.computeInitialAccelerations = True
        mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.TrapezoidalIndex2)
        found = [np.asarray(mbs.GetSensorStoredData(s)) for s in sensors]
        return np.array([value[0] + found[0][:, 3], found[1][:, 3]])

    return run
