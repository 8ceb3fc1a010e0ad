"""The `mebo-grasp` command line."""
