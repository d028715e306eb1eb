//! The types of the messages that we write, with the definitions of all they are made of, so that any tool can read
//! them.

/// A type of messages.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Definition {
    pub name: &'static str,
    /// MD5 of the definition by the rules of ROS 1; empty in ROS 2.
    pub md5: &'static str,
    /// Fields of it.
    fields: &'static str,
    /// Names and fields of what it is made of.
    parts: &'static [(&'static str, &'static str)],
}

impl Definition {
    /// The definition as files hold it.
    pub fn text(&self) -> String {
        let part = |(name, fields): &(&str, &str)| format!("{}\nMSG: {name}\n{fields}", "=".repeat(80));
        let parts: String = self.parts.iter().map(part).collect();
        format!("{}{parts}", self.fields)
    }
}

const HEADER_1: (&str, &str) = ("std_msgs/Header", "uint32 seq\ntime stamp\nstring frame_id\n");
const HEADER_2: (&str, &str) = ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n");
const TIME: (&str, &str) = ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n");
const QUATERNION: (&str, &str) = ("geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n");
const VECTOR: (&str, &str) = ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n");

const IMU: &str = "\
std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
";

const IMAGE: &str = "\
std_msgs/Header header
uint32 height
uint32 width
string encoding
uint8 is_bigendian
uint32 step
uint8[] data
";

/// Types of ROS 1.
pub(crate) mod ros1 {
    use super::{Definition, HEADER_1, IMAGE, IMU, QUATERNION, VECTOR};

    pub(crate) const EVENT_ARRAY: Definition = Definition {
        name: "dvs_msgs/EventArray",
        md5: "5e8beee5a6c107e504c2e78903c224b8",
        fields: "std_msgs/Header header\nuint32 height\nuint32 width\ndvs_msgs/Event[] events\n",
        parts: &[HEADER_1, ("dvs_msgs/Event", "uint16 x\nuint16 y\ntime ts\nbool polarity\n")],
    };
    pub(crate) const IMU_SAMPLE: Definition = Definition {
        name: "sensor_msgs/Imu",
        md5: "6a62c6daae103f4ff57a132d6f95cec2",
        fields: IMU,
        parts: &[HEADER_1, QUATERNION, VECTOR],
    };
    pub(crate) const FRAME: Definition = Definition {
        name: "sensor_msgs/Image",
        md5: "060021388200f6f0f447d0fcd9c64743",
        fields: IMAGE,
        parts: &[HEADER_1],
    };
}

/// Types of ROS 2.
pub(crate) mod ros2 {
    use super::{Definition, HEADER_2, IMAGE, IMU, QUATERNION, TIME, VECTOR};

    pub(crate) const EVENT_PACKET: Definition = Definition {
        name: "event_camera_msgs/msg/EventPacket",
        md5: "",
        fields: "\
std_msgs/Header header
uint32 height
uint32 width
uint64 seq
uint64 time_base
string encoding
bool is_bigendian
uint8[] events
",
        parts: &[HEADER_2, TIME],
    };
    pub(crate) const IMU_SAMPLE: Definition = Definition {
        name: "sensor_msgs/msg/Imu",
        md5: "",
        fields: IMU,
        parts: &[HEADER_2, TIME, QUATERNION, VECTOR],
    };
    pub(crate) const FRAME: Definition =
        Definition { name: "sensor_msgs/msg/Image", md5: "", fields: IMAGE, parts: &[HEADER_2, TIME] };
}
