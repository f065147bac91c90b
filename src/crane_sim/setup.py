from setuptools import find_packages, setup

PACKAGE = "crane_sim"

setup(
    name=PACKAGE,
    version="0.1.0",
    license="Apache-2.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["data/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", ["launch/demo.launch.py", "launch/simulated_crane.launch.py"]),
    ],
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "make_bag = crane_sim.make_bag:main",
            "picture = crane_sim.picture:main",
            "planted = crane_sim.planted:main",
            "simulated_crane = crane_sim.simulated_crane:main",
            "view = crane_sim.view:main",
        ]
    },
)
