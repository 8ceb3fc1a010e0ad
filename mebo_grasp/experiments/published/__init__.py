"""Figures that the sources print, to stand beside ours."""
