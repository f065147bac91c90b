from setuptools import find_packages, setup

PACKAGE = "crane_identification"

setup(
    name=PACKAGE,
    version="0.1.0",
    license="Apache-2.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["data/*", "report/page.*", "discrepancy/report/page.*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", ["launch/identification.launch.py"]),
    ],
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "check_recording = crane_identification.recording_check.command:main",
            "diagnose = crane_identification.discrepancy.diagnose:main",
            "identify = crane_identification.identify:main",
            "identification = crane_identification.online.identification_node:main",
        ]
    },
)
