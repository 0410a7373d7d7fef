"""The benchmark: ground-truth URDFs as static meshes, the engine run on them, and the table."""
