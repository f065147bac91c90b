import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "crane_driver"
TOOLS = {  # they run without ROS
    "decode": "crane_driver.decode:main",
}
NODES = {
    "bringup": "crane_driver.operator.bringup.main:main",
    "driver": "crane_driver.driver_node:main",
    "jog": "crane_driver.operator.jog.jog_node:main",
    "panel": "crane_driver.operator.panel.panel_node:main",
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
    package_data={PACKAGE: ["py.typed", "operator/panel/page/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/config", sorted(map(str, Path().glob("config/*.yaml")))),
        (f"share/{PACKAGE}/launch", ["launch/driver.launch.py"]),
        (
            f"share/{PACKAGE}/realtime",
            ["realtime/crane-realtime.conf", "realtime/crane-driver.service"],
        ),
    ],
    zip_safe=False,
    install_requires=[
        "crane_bags",
        "crane_model",
        "crane_nodes",
        "numba",
        "numpy",
        "pyyaml",
    ],
    extras_require={
        "can": ["canopen", "cantools", "msgpack", "polars>=1", "pydantic>=2", "python-can"],
        "mf4": ["python-can[mf4]"],
        "ros": ["matplotlib", "rich", "ruamel.yaml", "scipy", "tornado", "typing-extensions"],
    },
    entry_points={"console_scripts": scripts},
)
