"""The face of mam-sim: command-line verbs, configuration, doctor and report."""

__version__ = "0.1.0"
