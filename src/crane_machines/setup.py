import xml.etree.ElementTree as ElementTree
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "crane_machines"
MACHINES = sorted(path.parent for path in Path(PACKAGE).glob("*/machine.yaml"))

setup(
    name=PACKAGE,
    version=ElementTree.parse(Path(__file__).with_name("package.xml")).findtext("version"),
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[PACKAGE]),
    package_data={PACKAGE: ["py.typed", "*/*.dbc", "*/*.yaml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        *(
            (f"share/{PACKAGE}/{machine.name}", sorted(map(str, machine.glob("*.*"))))
            for machine in MACHINES
        ),
    ],
    zip_safe=False,
    install_requires=[],
    entry_points={"console_scripts": []},
)
