from setuptools import find_packages, setup

PACKAGE = "crane_driver"

setup(
    name=PACKAGE,
    version="0.1.0",
    license="Apache-2.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["data/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", ["launch/driver.launch.py"]),
    ],
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "bringup = crane_driver.bringup.main:main",
            "decode = crane_driver.decode:main",
            "driver = crane_driver.driver_node:main",
            "jog = crane_driver.jog.jog_node:main",
            "player = crane_driver.recording.player:main",
            "recorder = crane_driver.recording.recorder:main",
            "recover = crane_driver.recording.recover:main",
        ]
    },
)
