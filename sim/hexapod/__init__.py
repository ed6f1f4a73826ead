"""The hexapod: kinematics in closed form, detector, gauges beside the struts, spiral."""
