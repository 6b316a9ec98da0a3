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
SECOC = Binding(
    declarations="""
void canroll_secoc_begin(void *secoc, const uint8_t *key, int32_t reset, int32_t listening);
void canroll_secoc_continue(void *secoc, int32_t message, int32_t reset);
void canroll_secoc_wait(void *secoc, int32_t elapsed_ticks);
int32_t canroll_secoc_judge(void *secoc, int32_t message, const uint8_t *frame, int32_t length);
void canroll_secoc_finish(void *secoc, int32_t slot, uint8_t *frame);
size_t canroll_secoc_size(void);
""",
    source="""
static void canroll_secoc_begin(
    void *secoc, const uint8_t *key, int32_t reset, int32_t listening)
{
    canroll_secoc_start(secoc, key, reset, listening);
}
static void canroll_secoc_continue(void *secoc, int32_t message, int32_t reset)
{
    canroll_secoc_resume(secoc, message, reset);
}
static void canroll_secoc_wait(void *secoc, int32_t elapsed_ticks)
{
    canroll_secoc_elapse(secoc, elapsed_ticks);
}
static int32_t canroll_secoc_judge(
    void *secoc, int32_t message, const uint8_t *frame, int32_t length)
{
    return canroll_secoc_verify(secoc, message, frame, length);
}
static void canroll_secoc_finish(void *secoc, int32_t slot, uint8_t *frame)
{
    canroll_secoc_protect(secoc, slot, frame);
}
static size_t canroll_secoc_size(void) { return sizeof(canroll_secoc); }
""",
)
NVM = Binding(
    declarations="""
void canroll_nvm_put(void *nvm, const void *ecu, const void *cal);
int32_t canroll_nvm_take(const void *nvm, void *ecu, const void *cal);
size_t canroll_nvm_bytes(void);
""",
    source="""
static void canroll_nvm_put(void *nvm, const void *ecu, const void *cal)
{
    canroll_nvm_save(nvm, ecu, cal);
}
static int32_t canroll_nvm_take(const void *nvm, void *ecu, const void *cal)
{
    return canroll_nvm_restore(nvm, ecu, cal);
}
static size_t canroll_nvm_bytes(void) { return sizeof(canroll_nvm); }
""",
)
NVM_UDS = Binding(
    declarations="""
void canroll_nvm_uds_put(void *nvm, const void *uds);
int32_t canroll_nvm_uds_take(const void *nvm, void *uds, const void *ecu, const void *cal);
""",
    source="""
static void canroll_nvm_uds_put(void *nvm, const void *uds)
{
    canroll_nvm_uds_save(nvm, uds);
}
static int32_t canroll_nvm_uds_take(const void *nvm, void *uds, const void *ecu, const void *cal)
{
    return canroll_nvm_uds_restore(nvm, uds, ecu, cal);
}
""",
)
BINDINGS = {"xcp": XCP, "uds": UDS, "secoc": SECOC, "nvm": NVM, "nvm_uds": NVM_UDS}
"""By the name of the service."""
