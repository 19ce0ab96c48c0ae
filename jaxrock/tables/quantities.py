"""Units of quantities by the names that they have in tables."""

UNITS = {
    **dict.fromkeys(("amplitude",), "m/s2"),
    **dict.fromkeys(("intensity", "critical_intensity"), "m/s"),
    **dict.fromkeys(("duration", "time", "residual"), "s"),
    **dict.fromkeys(("peak_rotation", "rotation_residual"), "rad"),
    **dict.fromkeys(("frequency", "velocity_before"), "rad/s"),
    **dict.fromkeys(
        (
            "half_width",
            "width",
            "height",
            "width_at_this_height",
            "width_at_this_slenderness",
            "height_at_this_width",
        ),
        "m",
    ),
    **dict.fromkeys(
        (
            "factor",
            "slenderness",
            "inertia_ratio",
            "restitution",
            "velocity_ratio",
            "restitution_error",
            "critical_slenderness",
            "critical_restitution",
        ),
        "-",
    ),
}
