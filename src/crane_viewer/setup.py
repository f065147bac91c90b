import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "crane_viewer"
TOOLS = {  # they run without ROS
    "viewer": "crane_viewer.viewer:main"
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
        (
            f"share/{PACKAGE}/layouts",
            ["layouts/crane.rviz", "layouts/foxglove.json", "layouts/plotjuggler.xml"],
        ),
    ],
    zip_safe=False,
    install_requires=["crane_bags", "crane_model", "numpy", "rerun-sdk>=0.41", "rosbags>=0.11"],
    extras_require={"ros": ["crane_nodes"]},
    entry_points={"console_scripts": scripts},
)
