"""What shows itself in a notebook: one method for everything, made in `jaxnc.viz.shown` when it is asked for."""


class Shown:
    """A thing that notebooks show as a drawing and a short table; plain text elsewhere."""

    def _repr_html_(self) -> str:
        from jaxnc.viz.shown import shown

        return shown(self)
