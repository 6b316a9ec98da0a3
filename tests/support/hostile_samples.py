"""Good files of the formats that are text, small, each with what its reader tells apart."""

NETWORK = "schema = 1\nbitrate = 500000\nload = 0.3\ngateway_ms = [2, 4]\n"
SEGMENTS = """schema = 1

[segment.chassis]
bitrate = 500000
load = 0.4

[segment.body]
bitrate = 500000
traffic = "traffic.toml"

[[gateway]]
segments = ["chassis", "body"]
latency_ms = "gateway.csv"

[node.RollControl]
segment = "body"
jitter_ms = 0.1
"""
TRAFFIC = '[[message]]\nname = "A"\nid = 16\nbytes = 8\nperiod_ms = 10\njitter_ms = 1\n'
FAULTS = """[[fault]]
where = "Imu.RollRate"
kind = "offset"
value = 0.2
start = 2.0
"""
ARXML = """<?xml version="1.0" encoding="UTF-8"?>
<AUTOSAR xmlns="http://autosar.org/schema/r4.0"><AR-PACKAGES><AR-PACKAGE>
<SHORT-NAME>Car</SHORT-NAME><ELEMENTS>
<CAN-CLUSTER><SHORT-NAME>Body</SHORT-NAME><CAN-CLUSTER-VARIANTS><CAN-CLUSTER-CONDITIONAL>
<BAUDRATE>500000</BAUDRATE><PHYSICAL-CHANNELS><CAN-PHYSICAL-CHANNEL>
<SHORT-NAME>Channel</SHORT-NAME><FRAME-TRIGGERINGS><CAN-FRAME-TRIGGERING>
<SHORT-NAME>Doors</SHORT-NAME><FRAME-REF DEST="CAN-FRAME">/Car/Doors</FRAME-REF>
<CAN-ADDRESSING-MODE>STANDARD</CAN-ADDRESSING-MODE><IDENTIFIER>1280</IDENTIFIER>
</CAN-FRAME-TRIGGERING></FRAME-TRIGGERINGS></CAN-PHYSICAL-CHANNEL></PHYSICAL-CHANNELS>
</CAN-CLUSTER-CONDITIONAL></CAN-CLUSTER-VARIANTS></CAN-CLUSTER>
<CAN-FRAME><SHORT-NAME>Doors</SHORT-NAME><FRAME-LENGTH>8</FRAME-LENGTH><PDU-TO-FRAME-MAPPINGS>
<PDU-TO-FRAME-MAPPING><SHORT-NAME>Doors</SHORT-NAME>
<PACKING-BYTE-ORDER>MOST-SIGNIFICANT-BYTE-LAST</PACKING-BYTE-ORDER>
<PDU-REF DEST="I-SIGNAL-I-PDU">/Car/DoorsPdu</PDU-REF><START-POSITION>0</START-POSITION>
</PDU-TO-FRAME-MAPPING></PDU-TO-FRAME-MAPPINGS></CAN-FRAME>
<I-SIGNAL-I-PDU><SHORT-NAME>DoorsPdu</SHORT-NAME><LENGTH>8</LENGTH>
<I-PDU-TIMING-SPECIFICATIONS><I-PDU-TIMING><TRANSMISSION-MODE-DECLARATION>
<TRANSMISSION-MODE-TRUE-TIMING><CYCLIC-TIMING><TIME-PERIOD><VALUE>0.05</VALUE></TIME-PERIOD>
</CYCLIC-TIMING></TRANSMISSION-MODE-TRUE-TIMING></TRANSMISSION-MODE-DECLARATION></I-PDU-TIMING>
</I-PDU-TIMING-SPECIFICATIONS></I-SIGNAL-I-PDU></ELEMENTS></AR-PACKAGE></AR-PACKAGES></AUTOSAR>
"""
MEASURED = "time_ms;comment\n1.5;first\n2.25;# second\n4;\n"
CATALOGUE = """[[single]]
name = "roll rate stuck"
faults = "Imu.RollRate=stuck@1.6"
expect = "detected"
mode = "SAFE"

[[double]]
name = "roll rate and command"
faults = "Imu.RollRate=offset:0.1@1 + front=weak:0.3@1"
expect = "tolerated"
"""
KEY = 'key = "00112233445566778899aabbccddeeff"\n'
MEMORY = '{"starts": 3, "senders": {"Imu": 2, "RollControl": 1}}\n'
PLAN = '{"digest": "digest", "arguments": ["campaign", "fishhook.toml"], "runs": 2}\n'
OUTPUTS = ("x", "y", "yaw", "vx", "ay", "yaw_rate", "roll")
DESCRIPTION = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="van" guid="van">
<CoSimulation modelIdentifier="van" canHandleVariableCommunicationStepSize="true"/>
<UnitDefinitions><Unit name="deg"/></UnitDefinitions><DefaultExperiment stepSize="0.005"/>
<ModelVariables>
<ScalarVariable name="delta" valueReference="0" causality="input">
<Real unit="deg" start="0"/></ScalarVariable>
<ScalarVariable name="v0" valueReference="1" causality="parameter" variability="fixed">
<Real start="10"/></ScalarVariable>
{
    "".join(
        f'<ScalarVariable name="{name}" valueReference="{n}" causality="output"><Real/>'
        "</ScalarVariable>"
        for n, name in enumerate(OUTPUTS, 2)
    )
}
</ModelVariables><ModelStructure/></fmiModelDescription>
"""
PLANT_MAP = (
    """step_ms = 5
ignored = ["drive_force"]

[inputs]
delta = { from = "steer", unit = "deg" }

[outputs]
"""
    + "".join(f'{name} = "{name}"\n' for name in OUTPUTS)
    + """
[start]
v0 = "speed"
"""
)
TEXTS = {
    "catalogue/catalogue.toml": CATALOGUE,
    "chunk/plan.json": PLAN,
    "faults/faults.toml": FAULTS,
    "fmu/van.toml": PLANT_MAP,
    "gains/gains.toml": "K = [[14400.0, 6000.0]]\nKff = 120.0\n",
    "network/gateway.csv": MEASURED,
    "network/network.toml": NETWORK,
    "network/others.arxml": ARXML,
    "network/segments.toml": SEGMENTS,
    "network/traffic.toml": TRAFFIC,
    "secured/bus.key": KEY,
    "secured/memory.json": MEMORY,
    "signal/signal.csv": "time,steering_wheel_deg\n0,0\n1,10\n2.5,-10\n",
}
"""Content by folder and file."""
