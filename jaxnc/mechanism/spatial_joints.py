"""Joints in space, as builder methods (source text §4.2)."""

from jaxnc.errors import MechanismError, nearest
from jaxnc.mechanism import model as record
from jaxnc.mechanism.joints import JointBuilder


class SpatialJointBuilder(JointBuilder):
    """The part of `Mechanism` that adds joints of spatial mechanisms.

    A line is given by a point and a vector, or by two points; a direction by a vector or by two points. What two
    bodies share (a point, a vector) needs no joint and no equation.
    """

    def spherical(self, name: str, point: str, other: str) -> str:
        """Join two bodies by a ball joint where each has a point of its own (§4.2.1).

        Args:
            name: its name.
            point: the ball's centre in one body.
            other: the same in the other.
        """
        what = f"spherical joint {name!r}"
        self._in_space(what, "use revolute()")
        self._new_joint(name)
        self._distinct((point, other), what)
        self.model.joints[name] = record.Spherical((point, other))
        return name

    def cylindrical(self, name: str, line: tuple[str, str], on: str | tuple[str, str]) -> str:
        """Let a body slide along and turn about a line of another, (128)-(130), (135)-(140).

        Args:
            name: its name.
            line: the axis in one body, a point and a vector or two points.
            on: the other body's point on the axis if it shares the axis's vector, else its own line.
        """
        what = f"cylindrical joint {name!r}"
        self._in_space(what)
        self._new_joint(name)
        self.model.joints[name] = record.Cylindrical(*self._slide(line, on, what))
        return name

    def universal(
        self,
        name: str,
        axes: tuple[record.Direction, record.Direction],
        point: str | None = None,
        other: str | None = None,
    ) -> str:
        """Join two bodies by a universal (Cardan) joint: the arms of its cross keep their angle, (142).

        Args:
            name: its name.
            axes: the arm of the cross that turns in each body, a vector or two points.
            point: centre of the cross in one body; leave both points out where the bodies share it.
            other: the same in the other body.
        """
        what = f"universal joint {name!r}"
        self._in_space(what)
        self._new_joint(name)
        points = self._both(point, other, what)
        self.model.joints[name] = record.Universal(self._directions(axes, what), points)
        return name

    def screw(
        self,
        name: str,
        line: tuple[str, str],
        on: str | tuple[str, str],
        directions: tuple[record.Direction, record.Direction],
        angle: str,
        distance: str,
        lead: float | None = None,
        pitch: float | None = None,
    ) -> str:
        """Join two bodies by a screw (helical) joint: a cylindrical one whose advance is proportional to its turn.

        Creates the coordinates `angle` (about the line, from the first of `directions` to the second) and `distance`
        (along the line, to the point of `on`).

        Args:
            name: its name.
            line: the axis in one body, a point and a vector or two points.
            on: the other body's point on the axis if it shares the axis's vector, else its own line.
            directions: a direction of each body that is not along the line, to measure the turn.
            angle: name of the new angle.
            distance: name of the new distance.
            lead: advance per turn, a length, positive for a right-handed screw.
            pitch: instead of `lead`: advance per radian.
        """
        what = f"screw joint {name!r}"
        self._in_space(what)
        self._new_joint(name)
        line, on = self._slide(line, on, what)
        pair = self._directions(directions, what)
        self._new_coordinates(angle, distance, what)
        if (lead is None) == (pitch is None):
            raise MechanismError(f"{what}: give its lead (advance per turn) or its pitch (advance per radian)")
        lead, pitch = (None if x is None else self._finite(x, f"{what}: lead or pitch") for x in (lead, pitch))
        self.model.joints[name] = record.Screw(line, on, pair, angle, distance, lead, pitch)
        return name

    def planar(self, name: str, plane: tuple[str, str], on: str | tuple[str, str]) -> str:
        """Let a body slide and turn on a plane of another (planar joint): three relative freedoms.

        Args:
            name: its name.
            plane: a point of the plane and its normal, a vector, in one body.
            on: the other body's point on the plane (at the drawn height above it) if it shares the normal, else the
                point and its own normal. The point and the plane's normal: the point alone stays at that height, such
                as a ball at the end of a rod that may tilt.
        """
        what = f"planar joint {name!r}"
        self._in_space(what, "in the plane every body has these freedoms")
        self._new_joint(name)
        for spec in (plane, on):
            if spec is on and isinstance(spec, str):
                continue
            if not isinstance(spec, (tuple, list)) or len(spec) != 2 or spec[1] not in self.all_vectors:
                raise MechanismError(f"{what}: a plane is a point and its normal vector, ('P', 'n'); got {spec!r}")
        plane, on = self._slide(plane, on, what)
        self.model.joints[name] = record.Planar(plane, on)
        return name

    def bevel_gear(
        self,
        name: str,
        angle1: str,
        angle2: str,
        radii: tuple[float, float] | None = None,
        internal: bool = False,
        pressure_angle: float | None = None,
    ) -> str:
        """Mesh two wheels on axes at any angle, also parallel ones, (157): ``R1 φ1 ± R2 φ2 = c``.

        The sign follows from the drawing: with both axes pointing away from the point where they meet (or both towards
        it), or parallel the same way, it is plus. ``internal=True`` reverses it.

        Args:
            name: its name.
            angle1: angle of the first wheel about its axis.
            angle2: angle of the second wheel about its axis.
            radii: pitch radii, lengths (numbers of teeth do as well, except for reactions between axes that meet); read
                off the drawing (axis to the point that the angle goes to) if not given.
            internal: whether the larger wheel is toothed inside.
            pressure_angle: rad; reactions then have the separating force F tan α beside the tangential force F.
        """
        what = f"bevel gear {name!r}"
        self._in_space(what, "use gear()")
        self._new_joint(name)
        pressure = self._pressure(pressure_angle, what)
        self.model.joints[name] = record.BevelGear(*self._wheels(what, angle1, angle2, radii), bool(internal), pressure)
        return name

    def rack_and_pinion(
        self,
        name: str,
        angle: str,
        distance: str,
        radius: float | None = None,
        pressure_angle: float | None = None,
    ) -> str:
        """Let a pinion drive a rack, (199): ``s ∓ R ψ = c``, the sign from the side on which it is drawn.

        Args:
            name: its name.
            angle: the pinion's angle about its axis, from a direction that stands still to the pinion.
            distance: the rack's distance along its line, from a point that stands still to the rack.
            radius: pitch radius, a length; read off the drawing (the pinion's centre to the rack's line) if not given.
            pressure_angle: rad; reactions then have the separating force F tan α beside the tangential force F.
        """
        what = f"rack and pinion {name!r}"
        self._in_space(what, "use rolling(), or relation({distance: 1, angle: -radius})")
        self._new_joint(name)
        for noun, coordinate, known in (
            ("angle", angle, self.model.angles),
            ("distance", distance, self.model.distances),
        ):
            if coordinate not in known:
                raise MechanismError(f"{what}: unknown {noun} {coordinate!r}; {nearest(coordinate, known)}")
        r = None if radius is None else self._positive(radius, f"{what}: radius")
        self.model.joints[name] = record.RackAndPinion(angle, distance, r, self._pressure(pressure_angle, what))
        return name

    def constant_velocity(
        self,
        name: str,
        axes: tuple[record.Direction, record.Direction],
        marks: tuple[record.Direction, record.Direction],
        point: str | None = None,
        other: str | None = None,
    ) -> str:
        """Join two shafts by a constant-velocity joint.

        Args:
            name: its name.
            axes: the axis of each shaft, pointing the same way along the drive line.
            marks: a direction of each shaft that is not along its axis, to count its rotation from the drawing.
            point: centre of the joint in one body; leave both points out where the bodies share it.
            other: the same in the other body.
        """
        what = f"constant-velocity joint {name!r}"
        self._in_space(what)
        self._new_joint(name)
        points = self._both(point, other, what)
        self.model.joints[name] = record.ConstantVelocity(
            self._directions(axes, what), self._directions(marks, what), points
        )
        return name

    def rolling_disc(
        self, name: str, centre: str, axis: str, mark: str, plane: tuple[str, str], radius: float | None = None
    ) -> str:
        """Let a disc roll on a plane of the ground, leaning and turning as it likes, without slip (nonholonomic).

        One row keeps its rim on the plane; two rows, linear in velocities, keep it from slipping. Positions do not see
        these two: counts, poses and sweeps are those of a disc that slides, and they act in `jaxnc.simulate`.

        Args:
            name: its name.
            centre: centre of the disc.
            axis: a unit vector of the disc's body, its axis of rotation.
            mark: another unit vector of the body, not along the axis, by which its rotation is known.
            plane: a point of the plane and its normal, on the side of the disc; both of the ground.
            radius: length; read off the drawing if not given.
        """
        what = f"rolling disc {name!r}"
        self._in_space(what, "use rolling() or skate()")
        self._new_joint(name)
        self._known_point(centre, what)
        for u in (axis, mark):
            self._known_vector(u, what)
        if axis == mark:
            raise MechanismError(f"{what}: axis and mark are both {axis!r}; give another vector of the disc as mark=")
        if not isinstance(plane, (tuple, list)) or len(plane) != 2:
            raise MechanismError(f"{what}: a plane is a point and its normal vector, ('O', 'n'); got {plane!r}")
        point, normal = plane
        if point not in self.model.ground or normal not in self.model.ground_vectors:
            raise MechanismError(f"{what}: its plane must be of the ground: a point of ground() and a ground_vector(); "
                                 f"got {plane!r}")  # fmt: skip
        r = None if radius is None else self._positive(radius, f"{what}: radius")
        self.model.joints[name] = record.RollingDisc(centre, axis, mark, (point, normal), r)
        return name
