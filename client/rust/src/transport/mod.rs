//! Shared memory, for the daemon and for the ports of this crate; users of the client need none of it.

mod outlet;
mod space;
mod variant;

pub use outlet::{Loan, Outlet, Patience};
pub use space::{free_bytes, reserve};
pub use variant::Gated;

use crate::{Error, Qos, Root, Stream};
use iceoryx2::prelude::{
    Config, FileName, LogLevel, Node, NodeBuilder, NodeName, Path, SemanticString, ServiceName,
    SignalHandlingMode, set_log_level_from_env_or,
};
use iceoryx2::service::port_factory::{event, publish_subscribe};

/// Prefix of every file of iceoryx2 in a root.
pub const PREFIX: &str = "l_";

/// The publish-subscribe service of a stream of `T` with header `H`.
pub type DataService<T, H> = publish_subscribe::PortFactory<Gated, [T], H>;
/// The event service that wakes the clients of a stream.
pub type WakeService = event::PortFactory<Gated>;

/// The configuration of iceoryx2 for an instance: always explicit, so that no file lying about can split the world.
fn config(root: &Root) -> Result<Config, Error> {
    let path = Path::new(root.path().as_os_str().as_encoded_bytes())
        .map_err(|error| Error::transport("path of the instance", error))?;
    let mut config = Config::default();
    config.global.set_root_path(&path);
    config.global.prefix = FileName::new(PREFIX.as_bytes())
        .map_err(|error| Error::transport("prefix of the instance", error))?;
    Ok(config)
}

/// A node in the instance, whose directory must exist. Signals are left to the program.
pub fn node(root: &Root, name: &str) -> Result<Node<Gated>, Error> {
    root.identity()?;
    set_log_level_from_env_or(LogLevel::Error);
    let name = NodeName::new(name).map_err(|error| Error::transport("name of the node", error))?;
    NodeBuilder::new()
        .name(&name)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .config(&config(root)?)
        .create::<Gated>()
        .map_err(|error| node_error(root, error))
}

fn node_error(root: &Root, error: iceoryx2::node::NodeCreationFailure) -> Error {
    use iceoryx2::node::NodeCreationFailure as Failure;
    let writable = std::fs::metadata(root.path().join("nodes")).is_ok();
    match error {
        Failure::InsufficientPermissions => Error::Permission { root: root.clone() },
        Failure::InternalError if !writable => Error::Permission { root: root.clone() },
        error => Error::transport("node in shared memory", error),
    }
}

/// Opens the services of a stream, and makes them where there are none: the daemon's side.
pub fn create_services<T, H>(
    node: &Node<Gated>,
    stream: &Stream,
    camera: &str,
) -> Result<(DataService<T, H>, WakeService), Error>
where
    T: core::fmt::Debug + iceoryx2::prelude::ZeroCopySend,
    H: core::fmt::Debug + iceoryx2::prelude::ZeroCopySend,
{
    let qos = Qos::of(stream);
    let name = service_name(stream, camera)?;
    let data = node
        .service_builder(&name)
        .publish_subscribe::<[T]>()
        .user_header::<H>()
        .subscriber_max_buffer_size(qos.depth)
        .subscriber_max_borrowed_samples(qos.held_max)
        .history_size(qos.history)
        .max_subscribers(qos.clients_max)
        .max_publishers(PUBLISHERS_MAX)
        .max_nodes(NODES_MAX)
        .enable_safe_overflow(qos.overflow)
        .open_or_create()
        .map_err(|error| Error::transport(&format!("service {name}"), error))?;
    let wake = node
        .service_builder(&name)
        .event()
        .max_listeners(qos.clients_max)
        .max_notifiers(PUBLISHERS_MAX)
        .max_nodes(NODES_MAX)
        .open_or_create()
        .map_err(|error| Error::transport(&format!("wake-up of service {name}"), error))?;
    Ok((data, wake))
}

/// Opens the services of a stream that the daemon has made: the client's side.
pub(crate) fn open_services<T, H>(
    node: &Node<Gated>,
    stream: &Stream,
    camera: &str,
) -> Result<(DataService<T, H>, WakeService), Error>
where
    T: core::fmt::Debug + iceoryx2::prelude::ZeroCopySend,
    H: core::fmt::Debug + iceoryx2::prelude::ZeroCopySend,
{
    let name = service_name(stream, camera)?;
    let data = node
        .service_builder(&name)
        .publish_subscribe::<[T]>()
        .user_header::<H>()
        .open()
        .map_err(|error| Error::transport(&format!("service {name}"), error))?;
    let wake = node
        .service_builder(&name)
        .event()
        .open()
        .map_err(|error| Error::transport(&format!("wake-up of service {name}"), error))?;
    Ok((data, wake))
}

// One daemon publishes; the second place is that of a dead one not yet cleaned away.
const PUBLISHERS_MAX: usize = 2;
const NODES_MAX: usize = 20;

fn service_name(stream: &Stream, camera: &str) -> Result<ServiceName, Error> {
    let name = stream.service_name(camera);
    ServiceName::new(&name).map_err(|error| Error::transport(&format!("name {name}"), error))
}
