"""URDF: the tree of links and joints, the surfaces of links, reading and writing."""
