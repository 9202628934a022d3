"""The warehouse: a gripper sorts boxes from stacks onto carriers, which take them away."""
