"""Minimal deliberating agents: a cleaning robot, and a pair of sweeper and cleaner."""

from socialbot.core.registry import AgentPackage

AGENT = AgentPackage(
    name="cleaner",
    module="socialbot.agents.cleaner",
    nodes={
        "cleaner": "socialbot.agents.cleaner.cleaner:Cleaner",
        "sweeper": "socialbot.agents.cleaner.cleaner:Sweeper",
        "team_cleaner": "socialbot.agents.cleaner.cleaner:TeamCleaner",
    },
    graphs={"cleaner": "graph.yaml", "cleaner-sweeper": "pair.yaml"},
    vocabulary="socialbot.agents.cleaner.vocabulary:VOCABULARY",
    demos={
        "cleaner": "socialbot.agents.cleaner.cleaner:cleaner",
        "cleaner-sweeper": "socialbot.agents.cleaner.cleaner:cleaner_sweeper",
    },
)
