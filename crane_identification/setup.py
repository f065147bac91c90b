import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "crane_identification"
TOOLS = {  # they run without ROS
    "check_recording": "crane_identification.check_recording:main",
    "diagnose": "crane_identification.diagnose:main",
    "export": "crane_identification.export:main",
    "identify": "crane_identification.identify:main",
    "simulate": "crane_identification.simulate:main",
}
NODES = {
    "identification": "crane_identification.online.identification_node:main",
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
    package_data={
        PACKAGE: ["py.typed", "data/*", "report/page.*", "diagnosis/page.*", "diagnosis/*.txt"]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (
            f"share/{PACKAGE}/config",
            sorted(
                map(str, [*Path(PACKAGE, "data").glob("*.yaml"), *Path().glob("config/*.yaml")])
            ),
        ),
        (f"share/{PACKAGE}/launch", ["launch/identification.launch.py"]),
    ],
    zip_safe=False,
    install_requires=[
        "clarabel",
        "crane_bags",
        "crane_model",
        "crane_observer",
        "cvxpy-base",
        "filterpy",
        "jinja2",
        "markupsafe",
        "numba",
        "numpy",
        "plotly",
        "polars>=1",
        "pydantic>=2",
        "rich",
        "scikit-learn",
        "scipy",
        "threadpoolctl",
    ],
    extras_require={
        "cluster": ["distributed"],
        "mjcf": ["mujoco"],
        "ros": ["crane_nodes"],
    },
    entry_points={"console_scripts": scripts},
)
