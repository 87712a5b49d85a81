"""The leaf: outline, holes, surface and veins."""
