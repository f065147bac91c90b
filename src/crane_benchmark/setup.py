import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "crane_benchmark"
ROS_TOOLS = {"rehearse": "crane_benchmark.rehearsal.rehearse:main"}
TOOLS = {  # they run without ROS
    "discrepancy": "crane_benchmark.benchmark:main",
    "leave_one_out": "crane_benchmark.leave_one_out:main",
    "loads": "crane_benchmark.observing.loads:main",
    "observer": "crane_benchmark.observing.observer:main",
    "sensors": "crane_benchmark.observing.sensors:main",
    "study": "crane_benchmark.study.study:main",
}

if {"bdist_wheel", "editable_wheel"} & set(sys.argv):
    # pip puts scripts on the path of everyone, where short names are taken
    scripts = [f"crane-{name.replace('_', '-')} = {main}" for name, main in TOOLS.items()]
else:
    scripts = [f"{name} = {main}" for name, main in (TOOLS | ROS_TOOLS).items()]

setup(
    name=PACKAGE,
    version=ElementTree.parse(Path(__file__).with_name("package.xml")).findtext("version"),
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "data/emps/*", "scores/*.json", "rehearsal/page.html"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    zip_safe=False,
    install_requires=[
        "crane_bags",
        "crane_driver",
        "crane_identification",
        "crane_model",
        "crane_nodes",
        "crane_observer",
        "crane_sim",
        "crane_trajectory",
        "matplotlib",
        "mujoco",
        "numba",
        "numpy",
        "pydantic>=2",
        "rich",
        "ruamel.yaml",
        "scipy",
    ],
    extras_require={"regression": ["pysindy"]},
    entry_points={"console_scripts": scripts},
)
