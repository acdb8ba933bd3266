"""What became of a pose: one small integer per lane, whose text is a sentence."""

from enum import IntEnum


class Status(IntEnum):
    """Status of one pose. Zero means that the pose is right; everything else is a failure."""

    CONVERGED = 0
    DID_NOT_ASSEMBLE = 1
    SINGULAR = 2
    BRANCH_JUMP = 3
    NOT_REACHED = 4
    MIRRORED = 5
    LEFT_CLASS = 6
    TOO_FAR = 7
    STEP_UNDERFLOW = 8
    TOO_MANY_STEPS = 9
    STOPPED = 10
    CAME_APART = 11
    SINGULAR_START = 12

    @property
    def sentence(self) -> str:
        """The status as a sentence a person can read."""
        return _SENTENCES[self]


_SENTENCES = {
    Status.CONVERGED: "The pose was found and every constraint is met.",
    Status.DID_NOT_ASSEMBLE: (
        "No pose was found: the mechanism does not assemble at this input, or not on the branch that it began on."
    ),
    Status.SINGULAR: (
        "A singular position: the motion stops here (dead point or limit of travel of the input), or goes on through a "
        "change point, where a pose has no derivative."
    ),
    Status.BRANCH_JUMP: "A pose was found, but on another branch than the one asked for.",
    Status.MIRRORED: "A pose was found, but a body has turned into its mirror image in it.",
    Status.LEFT_CLASS: (
        "The design has left the class that its bodies were compiled for (points drawn in one line or segments in one "
        "plane no longer are): compile the mechanism anew."
    ),
    Status.TOO_FAR: (
        "Given up on the way: this input is too far from the one before; give poses in between. Of an angle beyond "
        "some hundred million radians turns are not told apart: take whole turns off."
    ),
    Status.SINGULAR_START: (
        "The pose to begin with, which is the drawing unless start= gives another, is a singular position of these "
        "inputs: branches meet there, and no branch is chosen. Draw the mechanism beside it, or give start=."
    ),
    Status.STEP_UNDERFLOW: (
        "The simulation broke off before: its step became too small for the clock (a singular position, or a force "
        "that is not finite)."
    ),
    Status.TOO_MANY_STEPS: "The simulation broke off before: it had made as many steps as it may.",
    Status.CAME_APART: (
        "The simulation broke off before: its constraints could no longer be met, its rates jumped, or its numbers "
        "were no longer finite (a step too long, a singular position, an input beyond reach)."
    ),
    Status.STOPPED: "The simulation had stopped before, at the event that it was asked to stop at.",
    Status.NOT_REACHED: "Not reached: the motion had already stopped at an earlier pose.",
}
