"""Warehouse: a gripper sorts boxes from stacks onto carriers, which take them away."""

from socialbot.core.registry import AgentPackage

AGENT = AgentPackage(
    name="warehouse",
    module="socialbot.agents.warehouse",
    nodes={
        "carrier": "socialbot.agents.warehouse.carrier:Carrier",
        "layout_gripper": "socialbot.agents.warehouse.gripper:LayoutGripper",
        "layout_world": "socialbot.agents.warehouse.world_node:LayoutWorld",
        "gripper": "socialbot.agents.warehouse.gripper:Gripper",
        "warehouse_world": "socialbot.agents.warehouse.world_node:World",
    },
    graphs={"warehouse": "graph.yaml"},
    messages=("socialbot.agents.warehouse.messages:WAREHOUSE_MESSAGES",),
    vocabulary="socialbot.agents.warehouse.vocabulary:VOCABULARY",
    world_view="socialbot.agents.warehouse.drawing:world_view",
    demos={"warehouse": "socialbot.agents.warehouse.demo:demo"},
    behaviours="behaviours.py",
)
