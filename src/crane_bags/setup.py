import xml.etree.ElementTree as ElementTree
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "crane_bags"

setup(
    name=PACKAGE,
    version=ElementTree.parse(Path(__file__).with_name("package.xml")).findtext("version"),
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "msg/*.msg"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    zip_safe=False,
    install_requires=["crane_model", "mcap", "numba", "numpy", "rosbags>=0.11"],
    entry_points={"console_scripts": []},
)
