#!/bin/sh
# Runs a command in a network of its own with one host, whose address is $FTAC_ROS2_ADDRESS: nothing leaves the computer.
#
# in_namespace.sh COMMAND...
set -eu
if [ -z "${FTAC_ROS2_ADDRESS:-}" ]; then
    export FTAC_ROS2_ADDRESS=10.77.0.1
    [ "$(id -u)" = 0 ] && exec unshare --net "$0" "$@"
    exec unshare --user --map-root-user --net "$0" "$@"
fi
ip link set lo up
# Peers with 127.0.0.1 alone receive nothing from rustdds; another address of the same interface serves.
ip addr add "$FTAC_ROS2_ADDRESS/32" dev lo
exec "$@"
