import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "crane_trajectory"
TOOLS = {  # they run without ROS
    "design": "crane_trajectory.design:main",
    "tune": "crane_trajectory.tune:main",
}
NODES = {
    "move": "crane_trajectory.move_node:main",
    "run_excitation": "crane_trajectory.run_excitation_node:main",
    "trajectory": "crane_trajectory.trajectory_node:main",
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
        (f"share/{PACKAGE}/launch", ["launch/trajectory.launch.py"]),
    ],
    zip_safe=False,
    install_requires=[
        "crane_model",
        "matplotlib",
        "numba",
        "numpy",
        "pydantic>=2",
        "scipy",
        "tqdm",
    ],
    extras_require={
        "ros": ["crane_nodes"],
    },
    entry_points={"console_scripts": scripts},
)
