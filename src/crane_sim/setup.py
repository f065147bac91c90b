import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "crane_sim"
TOOLS = {  # they run without ROS
    "film": "crane_sim.drawing.film:main",
    "make_bag": "crane_sim.make_bag:main",
    "picture": "crane_sim.drawing.picture:main",
    "true_values": "crane_sim.true_values:main",
    "simulated_crane": "crane_sim.simulated_crane:main",
    "view": "crane_sim.drawing.view:main",
}

if {"bdist_wheel", "editable_wheel"} & set(sys.argv):
    # pip puts scripts on the path of everyone, where short names are taken
    scripts = [f"crane-{name.replace('_', '-')} = {main}" for name, main in TOOLS.items()]
else:
    scripts = [f"{name} = {main}" for name, main in TOOLS.items()]

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
        (f"share/{PACKAGE}/launch", ["launch/demo.launch.py", "launch/simulated_crane.launch.py"]),
    ],
    zip_safe=False,
    install_requires=[
        "crane_bags",
        "crane_driver[can]",
        "crane_model",
        "crane_nodes",
        "crane_trajectory",
        "matplotlib",
        "mujoco",
        "numba",
        "numpy",
        "pillow",
        "pydantic>=2",
        "pyyaml",
        "scipy",
    ],
    entry_points={"console_scripts": scripts},
)
