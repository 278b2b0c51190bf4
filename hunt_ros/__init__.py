"""
hunt_ros: live monitoring of hunting motion on a railway roller rig.

The numerical rooms (`dynamics`, `estimation`, `detection`, `identification`,
`analysis`) need no ROS; the ROS 2 nodes are in `nodes`, the command line in
`cli`.
"""

__version__ = '0.2.0'
