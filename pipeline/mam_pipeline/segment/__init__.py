"""3D-native primitives: a mesh's faces cut into pieces that can be grouped into parts."""
