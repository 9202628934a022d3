"""How colcon installs socialbot, by a link to the package; pip takes the pyproject.toml above."""

from glob import glob
from xml.etree import ElementTree

from setuptools import find_namespace_packages, setup

PACKAGE = "socialbot"

manifest = ElementTree.parse("package.xml").getroot()
maintainer = manifest.find("maintainer")

setup(
    name=PACKAGE,
    version=manifest.findtext("version"),
    description=manifest.findtext("description"),
    license=manifest.findtext("license"),
    maintainer=maintainer.text,
    maintainer_email=maintainer.get("email"),
    packages=find_namespace_packages(include=[PACKAGE, f"{PACKAGE}.*"], exclude=["*.__pycache__"]),
    package_data={"": ["*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", glob("launch/*.launch.py")),
    ],
    entry_points={
        "console_scripts": ["socialbot = socialbot.__main__:run", "node = socialbot.__main__:run_node"],
    },
    zip_safe=False,
)
