"""ROS functions shared by the nodes: parameters, QoS, spinning, stamps, diagnostics."""
