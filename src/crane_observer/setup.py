import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "crane_observer"
TOOLS = {  # they run without ROS
    "check_sensors": "crane_observer.check_sensors:main",
    "estimate_positions": "crane_observer.estimate_positions:main",
    "estimate_payload": "crane_observer.estimate_payload:main",
}
NODES = {
    "position_estimator": "crane_observer.node.position_estimator_node:main",
    "payload_estimator": "crane_observer.node.payload_estimator_node:main",
    "sensor_monitor": "crane_observer.node.sensor_monitor_node:main",
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
        (f"share/{PACKAGE}/config", sorted(map(str, Path().glob("config/*.yaml")))),
        (f"share/{PACKAGE}/launch", ["launch/observer.launch.py"]),
    ],
    zip_safe=False,
    install_requires=["crane_bags", "crane_model", "matplotlib", "numba", "numpy", "scipy"],
    extras_require={"ros": ["crane_nodes"]},
    entry_points={"console_scripts": scripts},
)
