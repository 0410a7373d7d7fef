"""Trains the network of parts: which primitives move together, how, and about which line."""
