"""XCP on CAN in an A2L: the description of its blocks (AML) and the blocks themselves.

Names and order of the values are those of ASAM's XCP_common.aml and XCP_on_CAN.aml (ASAM MCD-1
XCP), as far as they are used here.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from canroll.codegen.generated.bus_map import XcpFrames

TIMEOUT_MS = 2000
"""The check of a page takes up to 80 ticks of up to 20 ms."""
COMMANDS = (
    "GET_COMM_MODE_INFO",
    "GET_ID",
    "GET_SEED",
    "SET_MTA",
    "UPLOAD",
    "SHORT_UPLOAD",
    "DOWNLOAD",
    "DOWNLOAD_MAX",
    "SET_CAL_PAGE",
    "GET_CAL_PAGE",
    "GET_PAG_PROCESSOR_INFO",
    "GET_SEGMENT_INFO",
    "GET_PAGE_INFO",
    "COPY_CAL_PAGE",
    "SET_DAQ_PTR",
    "WRITE_DAQ",
    "SET_DAQ_LIST_MODE",
    "GET_DAQ_LIST_MODE",
    "START_STOP_DAQ_LIST",
    "START_STOP_SYNCH",
    "GET_DAQ_CLOCK",
    "GET_DAQ_PROCESSOR_INFO",
    "GET_DAQ_RESOLUTION_INFO",
    "GET_DAQ_EVENT_INFO",
    "FREE_DAQ",
    "ALLOC_DAQ",
    "ALLOC_ODT",
    "ALLOC_ODT_ENTRY",
)
ENUM = ", ".join(f'"{name}" = {k}' for k, name in enumerate(COMMANDS))
A2ML = """\
    /begin A2ML
      block "IF_DATA" taggedunion if_data {
        "XCP" struct {
          taggedstruct {
            block "PROTOCOL_LAYER" struct {
              uint; uint; uint; uint; uint; uint; uint; uint; uchar; uint;
              enum { "BYTE_ORDER_MSB_LAST" = 0, "BYTE_ORDER_MSB_FIRST" = 1 };
              enum { "ADDRESS_GRANULARITY_BYTE" = 1, "ADDRESS_GRANULARITY_WORD" = 2 };
              taggedstruct { ("OPTIONAL_CMD" enum { COMMAND_ENUM })*; };
            };
            block "DAQ" struct {
              enum { "STATIC" = 0, "DYNAMIC" = 1 };
              uint; uint; uchar;
              enum { "OPTIMISATION_TYPE_DEFAULT" = 0 };
              enum { "ADDRESS_EXTENSION_FREE" = 0 };
              enum { "IDENTIFICATION_FIELD_TYPE_ABSOLUTE" = 0 };
              enum { "GRANULARITY_ODT_ENTRY_SIZE_DAQ_BYTE" = 1 };
              uchar;
              enum { "NO_OVERLOAD_INDICATION" = 0, "OVERLOAD_INDICATION_EVENT" = 2 };
              taggedstruct {
                "PRESCALER_SUPPORTED";
                block "TIMESTAMP_SUPPORTED" struct {
                  uint;
                  enum { "NO_TIME_STAMP" = 0, "SIZE_DWORD" = 4 };
                  enum { "UNIT_1US" = 3, "UNIT_1MS" = 6 };
                };
                (block "EVENT" struct {
                  char[101]; char[9]; uint;
                  enum { "DAQ" = 1, "STIM" = 2, "DAQ_STIM" = 3 };
                  uchar; uchar; uchar; uchar;
                })*;
              };
            };
            block "PAG" struct { uchar; };
            block "SEGMENT" struct {
              uchar; uchar; uchar; uchar; uchar;
              taggedstruct {
                (block "PAGE" struct {
                  uchar;
                  enum { "ECU_ACCESS_NOT_ALLOWED" = 0, "ECU_ACCESS_DONT_CARE" = 3 };
                  enum { "XCP_READ_ACCESS_NOT_ALLOWED" = 0, "XCP_READ_ACCESS_DONT_CARE" = 3 };
                  enum { "XCP_WRITE_ACCESS_NOT_ALLOWED" = 0,
                    "XCP_WRITE_ACCESS_WITHOUT_ECU_ONLY" = 1 };
                  taggedstruct { "INIT_SEGMENT" uchar; };
                })*;
              };
            };
            block "XCP_ON_CAN" struct {
              uint;
              taggedstruct {
                "CAN_ID_MASTER" ulong;
                "CAN_ID_SLAVE" ulong;
                "BAUDRATE" ulong;
              };
            };
          };
        };
      };
    /end A2ML""".replace("COMMAND_ENUM", ENUM)


@dataclass(frozen=True, slots=True)
class Slave:
    """A slave in the firmware: its lists, pages of the calibration, addresses by symbol."""

    lists: Sequence[str]
    segment: str
    addresses: Mapping[str, int]


def interface(xcp: XcpFrames, slave: Slave | None) -> Iterator[str]:
    """The blocks of the module; ``slave`` is None where it is not the firmware's."""
    timeouts = " ".join([str(TIMEOUT_MS if slave else 1000)] * 7)
    yield "    /begin IF_DATA XCP"
    yield "      /begin PROTOCOL_LAYER"
    yield f"        0x0100 {timeouts} 8 8"
    yield "        BYTE_ORDER_MSB_LAST ADDRESS_GRANULARITY_BYTE"
    if slave:
        yield from (f"        OPTIONAL_CMD {name}" for name in COMMANDS)
    yield "      /end PROTOCOL_LAYER"
    if slave:
        yield from slave.lists
        yield "      /begin PAG 1 /end PAG"
    yield "      /begin XCP_ON_CAN 0x0100"
    yield f"        CAN_ID_MASTER 0x{xcp.master:X}"
    yield f"        CAN_ID_SLAVE 0x{xcp.slave:X}"
    yield f"        BAUDRATE {xcp.bitrate}"
    yield "      /end XCP_ON_CAN"
    yield "    /end IF_DATA"
