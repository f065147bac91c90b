# Source this in bash or zsh for a shell in which `ros2 run PACKAGE EXECUTABLE` finds the suite:
#   source scripts/env.sh
# With ROS 2 Jazzy installed, source its setup file first.

_crane_env() {
    local root=$1 shell=$2 ros
    local profiles="$root/install/crane_nodes/share/crane_nodes/config/this_computer.xml"
    if ! [ -f "$root/install/crane-build" ] || ! [ -f "$profiles" ]; then
        echo "error: the suite is not set up; run: make -C '$root' setup" >&2
        return 1
    fi
    ros=$(sed -n 's/^include-system-site-packages = //p' "$root/.venv/pyvenv.cfg")
    if [ "$ros" = true ] && [ -z "${ROS_DISTRO:-}" ]; then
        echo "error: the suite was set up for an installed ROS;" \
            "first: source /opt/ros/jazzy/setup.$shell" >&2
        return 1
    elif [ "$ros" = false ] && [ -n "${ROS_DISTRO:-}" ]; then
        echo "error: ROS_DISTRO=$ROS_DISTRO is sourced, but the suite was set up without it;" \
            "run: make -C '$root' setup" >&2
        return 1
    fi

    export VIRTUAL_ENV="$root/.venv"
    case ":$PATH:" in
        *":$VIRTUAL_ENV/bin:"*) ;;
        *) export PATH="$VIRTUAL_ENV/bin:$PATH" ;;
    esac
    # Not install/setup.*: it puts back the prefixes of the build and so drops the virtual
    # environment, which is the ROS installation where ROS comes as wheels.
    if [ "$ros" = false ]; then
        export AMENT_PREFIX_PATH="$VIRTUAL_ENV"
    fi
    . "$root/install/local_setup.$shell" || return 1
    if ! command -v ros2 >/dev/null; then
        export PATH="$root/scripts/ros2_stand_in:$PATH"
    fi

    # Unless the shell asks for other computers, only nodes of this one see each other; as in
    # crane_nodes/this_computer.py, which says why.
    case "${FASTRTPS_DEFAULT_PROFILES_FILE:-}" in
    */crane_nodes/config/this_computer.xml) # it was sourced before
        unset FASTRTPS_DEFAULT_PROFILES_FILE
        if [ "${ROS_AUTOMATIC_DISCOVERY_RANGE:-}" = SYSTEM_DEFAULT ]; then
            unset ROS_AUTOMATIC_DISCOVERY_RANGE
        fi
        ;;
    esac
    export ROS_AUTOMATIC_DISCOVERY_RANGE="${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}"
    export RMW_IMPLEMENTATION="${RMW_IMPLEMENTATION:-rmw_fastrtps_cpp}"
    case "$ROS_AUTOMATIC_DISCOVERY_RANGE $RMW_IMPLEMENTATION ${FASTRTPS_DEFAULT_PROFILES_FILE:-}" in
    "LOCALHOST rmw_fastrtps"*" ")
        unset ROS_LOCALHOST_ONLY
        export ROS_AUTOMATIC_DISCOVERY_RANGE=SYSTEM_DEFAULT
        export FASTRTPS_DEFAULT_PROFILES_FILE="$profiles"
        ;;
    esac
}

if [ -n "${ZSH_VERSION:-}" ]; then
    _crane_env "${${(%):-%x}:A:h:h}" zsh
else
    _crane_env "$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)" bash
fi
