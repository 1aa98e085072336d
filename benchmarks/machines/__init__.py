"""Machines that nothing in the package was made with, and what is missing from their simulations."""

from machines import drives, electric, process, sensed, vehicles

# what is missing, "" for nothing and "unknown" for what the catalogue does not hold
TRIALS = {
    vehicles.quarter_car: ("coulomb_friction", "cubic_stiffness", "clearance"),
    vehicles.aircraft: ("rate_limit", "delay", "lag", "backlash", "sensor_clip"),
    vehicles.ship: ("rate_limit", "periodic_disturbance", "cubic_stiffness", ""),
    vehicles.car: ("coulomb_friction", "quadratic_drag", "input_saturation", "coupling", ""),
    vehicles.rotor: ("input_polynomial", "quadratic_drag", "gain_drift", ""),
    drives.crane: ("coulomb_friction", "quadratic_drag", "constant_load", ""),
    drives.wind_turbine: ("periodic_disturbance", "quadratic_drag", "constant_load", ""),
    drives.motor: ("cogging", "stribeck_friction"),
    drives.robot_arm: ("coulomb_friction", "gravity", ""),
    drives.belt: ("clearance", "cogging", "coulomb_friction", ""),
    drives.pendulum: ("coulomb_friction", "gravity", "extra_mode", ""),
    drives.mirror: ("cubic_stiffness", "quadratic_stiffness", "coulomb_friction", "creep", ""),
    drives.piezo: ("prandtl_ishlinskii",),
    drives.cart_with_pole: ("coulomb_friction", "dead_zone", "sensor_bias", ""),
    drives.table_of_two_axes: ("coupling", "temperature_gain", ""),
    process.hydraulic_cylinder: ("dead_zone", "input_saturation", "input_polynomial"),
    process.pneumatic_cylinder: ("dead_zone", "stribeck_friction", "asymmetric_friction", ""),
    process.tank: ("root_outflow",),
    process.oven: ("extra_mode",),
    process.heat_exchanger: ("delay", "lag", "coupling", ""),
    process.room: ("extra_mode", "coupling", "unknown", ""),
    process.flow_loop: ("valve_stiction", "backlash", "quantisation", ""),
    process.greenhouse: ("temperature_gain", "coupling", ""),
    process.canal: ("root_outflow", "constant_load", "overflow", ""),
    electric.battery: ("additive_drift", "sensor_clip"),
    electric.converter: ("dead_zone", "quantisation", "unknown", ""),
    electric.loudspeaker: ("quadratic_stiffness", "cubic_stiffness", "unknown", ""),
    electric.levitated_ball: ("lag", "constant_load", ""),
    sensed.shaker: ("cubic_stiffness", "input_saturation", "clearance", ""),
    sensed.slide: ("coulomb_friction", "cubic_stiffness", "lag", ""),
    sensed.two_masses: ("coulomb_friction", "cubic_stiffness", ""),
}
