"""ROS plumbing shared by the nodes: parameters, QoS, spinning, stamps, diagnostics."""
