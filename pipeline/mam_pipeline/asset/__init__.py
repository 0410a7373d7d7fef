"""The asset folder: its card (asset.json), its writer, collision, inertia and exports."""
