"""Message definitions of marine packages, for bags that carry none of their own.

Facts only, as their packages state them: types and names of the fields in their order. A bag's own
definitions win.
"""

from __future__ import annotations

DEFINITIONS: dict[str, str] = {
    "dvl_msgs/msg/DVLBeam": """
        int64 id
        float64 velocity
        float64 distance
        float64 rssi
        float64 nsd
        bool valid
    """,
    "dvl_msgs/msg/DVL": """
        std_msgs/Header header
        float64 time
        geometry_msgs/Vector3 velocity
        float64 fom
        float64 altitude
        dvl_msgs/DVLBeam[] beams
        bool velocity_valid
        int64 status
        string form
    """,
    "marine_acoustic_msgs/msg/Dvl": """
        std_msgs/Header header
        uint8 velocity_mode
        uint8 dvl_type
        geometry_msgs/Vector3 velocity
        float64[9] velocity_covar
        float64 altitude
        float64 course_gnd
        float64 speed_gnd
        uint8 num_good_beams
        float32 sound_speed
        bool beam_ranges_valid
        bool beam_velocities_valid
        geometry_msgs/Vector3[4] beam_unit_vec
        float64[4] range
        float32[4] range_covar
        float32[4] beam_quality
        float32[4] beam_velocity
        float32[4] beam_velocity_covar
    """,
    "provider_dvl/msg/PD0Packet": """
        float64 timestamp
        float64[4] range
        float64[4] velocity
        float64[4] correlation
        float64[4] evaluation
        float64[4] good_ping_ratio
        float64[4] rssi
    """,
    "cirs_girona_cala_viuda/msg/LinkquestDvl": """
        std_msgs/Header header
        string errcode
        int32[4] datagood
        float64[4] altitudebeam
        float64[4] bottomvelocitybeam
        float64[4] watervelocitybeam
        float64[4] watervelocitycredit
        float64[3] velocityinst
        int32 velocityinstflag
        float64[3] velocityearth
        int32 velocityearthflag
        float64[3] watervelocityinst
        int32 watervelocityinstflag
        float64[3] watervelocityearth
        int32 watervelocityearthflag
        float64 roll
        float64 pitch
        float64 heading
        float64 altitude
        float64 temperature
        float64 pressure
        float64 salinity
        float64 soundspeed
        string rawdata
    """,
    "cirs_girona_cala_viuda/msg/RangeImageBeam": """
        std_msgs/Header header
        float64 angle_grad
        float64 angle_rad
        int32 nbins
        int32 max_range
        int32[] beam_data
    """,
    "cirs_girona_cala_viuda/msg/Depth": """
        std_msgs/Header header
        float64 depth
    """,
    "ping360_sonar_msgs/msg/SonarEcho": """
        std_msgs/Header header
        float32 angle
        uint8 gain
        uint16 number_of_samples
        uint16 transmit_frequency
        uint16 speed_of_sound
        uint8 range
        uint8[] intensities
    """,
}
"""Type to its fields."""
