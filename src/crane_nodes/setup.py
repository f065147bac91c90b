import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "crane_nodes"
TOOLS = {  # they run without ROS
    "recover": "crane_nodes.recording.recover:main"
}
NODES = {
    "player": "crane_nodes.recording.player_node:main",
    "recorder": "crane_nodes.recording.recorder_node:main",
    "robot_state_publisher": "crane_nodes.robot_state_publisher:main",
}

if {"bdist_wheel", "editable_wheel"} & set(sys.argv):
    # pip puts scripts on the path of everyone, where short names are taken
    scripts = [f"crane-{name.replace('_', '-')} = {main}" for name, main in TOOLS.items()]
else:
    scripts = [f"{name} = {main}" for name, main in (TOOLS | NODES).items()]

setup(
    name=PACKAGE,
    version=ElementTree.parse(Path(__file__).with_name("package.xml")).findtext("version"),
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/config", sorted(map(str, Path().glob("config/*")))),
        (f"share/{PACKAGE}/security", ["security/policies.xml"]),
    ],
    zip_safe=False,
    install_requires=[
        "crane_bags",
        "crane_model",
        "mcap",
        "numpy",
        "pydantic>=2",
        "pyyaml",
        "rosbags>=0.11",
    ],
    entry_points={"console_scripts": scripts},
)
