"""An ament_python package: ``colcon build --packages-select ensemble_ctrl_ros``."""

from glob import glob

from setuptools import setup

NAME = "ensemble_ctrl_ros"

setup(
    name=NAME,
    version="0.2.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", glob("launch/*.launch.py")),
    ],
    install_requires=["setuptools", "ensemble-ctrl>=0.2"],
    zip_safe=True,
    maintainer="The ensemble_ctrl developers",
    description="Plays a plan of ensemble_ctrl to a fleet, and replans online from measured poses.",
    license="BSD-3-Clause",
    entry_points={"console_scripts": [f"play = {NAME}.play:main", f"online = {NAME}.online:main"]},
)
