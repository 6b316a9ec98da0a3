"""C functions of the services beside the loop, as cffi sees them."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Binding:
    """Declarations and source of a service's functions, on records without a type."""

    declarations: str
    source: str


XCP = Binding(
    declarations="""
void canroll_xcp_start(
    void *xcp, const void *reference, void *working, int32_t state, int32_t page);
void canroll_xcp_put(void *xcp, const uint8_t *payload, int32_t length);
void canroll_xcp_step(
    void *xcp, void *ecu, const void *reference, void *working, int32_t elapsed_ticks);
size_t canroll_xcp_size(void);
""",
    source="""
static void canroll_xcp_start(
    void *xcp, const void *reference, void *working, int32_t state, int32_t page)
{
    canroll_xcp_init(xcp, reference, working, state, page);
}
static void canroll_xcp_put(void *xcp, const uint8_t *payload, int32_t length)
{
    canroll_xcp_receive(xcp, payload, length);
}
static void canroll_xcp_step(
    void *xcp, void *ecu, const void *reference, void *working, int32_t elapsed_ticks)
{
    canroll_xcp_tick(xcp, ecu, reference, working, elapsed_ticks);
}
static size_t canroll_xcp_size(void) { return sizeof(canroll_xcp); }
""",
)
UDS = Binding(
    declarations="""
void canroll_uds_start(void *uds, const void *ecu);
void canroll_uds_put(void *uds, const uint8_t *payload, int32_t length);
void canroll_uds_step(void *uds, void *ecu, const void *cal, int32_t elapsed_ticks);
size_t canroll_uds_size(void);
""",
    source="""
static void canroll_uds_start(void *uds, const void *ecu)
{
    canroll_uds_init(uds, ecu);
}
static void canroll_uds_put(void *uds, const uint8_t *payload, int32_t length)
{
    canroll_uds_receive(uds, payload, length);
}
static void canroll_uds_step(void *uds, void *ecu, const void *cal, int32_t elapsed_ticks)
{
    canroll_uds_tick(uds, ecu, cal, elapsed_ticks);
}
static size_t canroll_uds_size(void) { return sizeof(canroll_uds); }
""",
)
BINDINGS = {"xcp": XCP, "uds": UDS}
"""By the name of the service."""
