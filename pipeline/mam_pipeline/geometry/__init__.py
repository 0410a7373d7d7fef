"""Shared numeric helpers: sampling, sweeps, boxes, frames."""
