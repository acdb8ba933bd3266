"""Pages and widgets: a motion in a browser, which calculates it anew."""
