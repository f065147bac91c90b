from setuptools import find_packages, setup

PACKAGE = "crane_trajectory"

setup(
    name=PACKAGE,
    version="0.1.0",
    license="Apache-2.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["data/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", ["launch/trajectory.launch.py"]),
    ],
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "design = crane_trajectory.design:main",
            "run_excitation = crane_trajectory.run_excitation_node:main",
            "trajectory = crane_trajectory.trajectory_node:main",
        ]
    },
)
