import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "crane_model"
TOOL = "crane_model.inspection.machine_command:main"
# pip puts scripts on the path of everyone, where short names are taken
NAME = "crane-machine" if {"bdist_wheel", "editable_wheel"} & set(sys.argv) else "machine"

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
    ],
    zip_safe=False,
    install_requires=[
        "annotated-types",
        "crane_machines",
        "matplotlib",
        "numba",
        "numpy",
        "pydantic>=2",
        "pydantic-core",
        "pyyaml",
        "scipy",
        "tqdm",
    ],
    entry_points={"console_scripts": [f"{NAME} = {TOOL}"]},
)
