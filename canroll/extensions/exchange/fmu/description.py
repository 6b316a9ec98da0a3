"""modelDescription.xml, terminalsAndIcons.xml, buildDescription.xml and the fmi-ls-bus manifest."""

from collections.abc import Iterable
from importlib.metadata import version
from xml.etree import ElementTree as Xml

from canroll.extensions.exchange.fmu.variables import (
    BINARY,
    CLOCK,
    INDEPENDENT,
    INPUT,
    LOCAL,
    MIME_TYPE,
    OUTPUT,
    PARAMETER,
    RX_CLOCK,
    RX_DATA,
    TX_CLOCK,
    TX_DATA,
    Interface,
    Variable,
)

UNITS: dict[str, dict[str, str]] = {
    "s": {"s": "1"},
    "m": {"m": "1"},
    "rad": {"rad": "1"},
    "rad/s": {"rad": "1", "s": "-1"},
    "m/s": {"m": "1", "s": "-1"},
    "m/s2": {"m": "1", "s": "-2"},
    "rad/s2": {"rad": "1", "s": "-2"},
    "N": {"kg": "1", "m": "1", "s": "-2"},
    "N.m": {"kg": "1", "m": "2", "s": "-2"},
    "Pa": {"kg": "1", "m": "-1", "s": "-2"},
    "A": {"A": "1"},
    "mA": {"A": "1", "factor": "0.001"},
    "bit/s": {"s": "-1"},
    "ns": {"s": "1", "factor": "1e-9"},
}
"""Base units of every unit in use; a ``factor`` converts to them."""
LS_BUS = "org.fmi-standard.fmi-ls-bus"
LS_BUS_VERSION = "1.0.0"
NANOSECONDS = 10**9


def unit_name(text: str) -> str:
    """A unit of canroll's tables as UNITS spells it; "" for what is not in it."""
    spelt = text.replace("N·m", "N.m").replace("Nm", "N.m").replace("²", "2")
    return spelt if spelt in UNITS else ""


def model_description(interface: Interface, token: str) -> str:
    """Text of modelDescription.xml."""
    root = Xml.Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName=interface.identifier,
        instantiationToken=token,
        description=interface.description,
        license="MIT",
        generationTool=f"canroll {version('canroll')}",
        variableNamingConvention="structured",
    )
    Xml.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=interface.identifier,
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
        hasEventMode="true",
    )
    used = {its.unit for its in interface.everything if its.unit}
    if used:
        units = Xml.SubElement(root, "UnitDefinitions")
        for unit, base in UNITS.items():
            if unit in used:
                Xml.SubElement(Xml.SubElement(units, "Unit", name=unit), "BaseUnit", base)
    if interface.step:
        Xml.SubElement(root, "DefaultExperiment", startTime="0", stepSize=f"{interface.step:.10g}")
    variables = Xml.SubElement(root, "ModelVariables")
    for reference, its in enumerate(interface.everything):
        _variable(variables, interface, reference, its)
    structure = Xml.SubElement(root, "ModelStructure")
    outputs = [k for k, its in enumerate(interface.everything) if its.causality == OUTPUT]
    for reference in outputs:
        Xml.SubElement(structure, "Output", valueReference=str(reference))
    for reference in outputs:
        if not interface.everything[reference].role:
            Xml.SubElement(structure, "InitialUnknown", valueReference=str(reference))
    return _text(root)


def _variable(parent: Xml.Element, interface: Interface, reference: int, its: Variable) -> None:
    element = Xml.SubElement(
        parent,
        its.type,
        name=its.name,
        valueReference=str(reference),
        causality=its.causality,
        variability=its.variability,
    )
    if its.description:
        element.set("description", its.description)
    if its.unit:
        element.set("unit", its.unit)
    if its.causality == LOCAL:
        element.set("initial", "calculated")
    if its.low is not None and its.high is not None:
        element.set("min", _number(its.low))
        element.set("max", _number(its.high))
    if its.causality in (INPUT, PARAMETER) and its.start:
        element.set("start", " ".join(_number(value) for value in its.start))
    for size in its.shape:
        Xml.SubElement(element, "Dimension", start=str(size))
    if its.type == CLOCK:
        _clock(element, interface, its)
    if its.type == BINARY:
        clock = RX_CLOCK if its.role == RX_DATA else TX_CLOCK
        name = f"{interface.terminals[its.terminal].name}.{clock}"
        element.set("clocks", str(interface.reference(name)))
        element.set("mimeType", MIME_TYPE)
        if its.causality == INPUT:
            Xml.SubElement(element, "Start", value="")
    if its.causality == INDEPENDENT:
        element.set("description", "simulation time")


def _clock(element: Xml.Element, interface: Interface, its: Variable) -> None:
    terminal = interface.terminals[its.terminal]
    if its.role == RX_CLOCK:
        element.set("intervalVariability", "triggered")
    elif terminal.period_ns:
        element.set("intervalVariability", "constant")
        element.set("intervalDecimal", _number(1e-9 * terminal.period_ns))
        element.set("shiftDecimal", _number(1e-9 * terminal.shift_ns))
        element.set("supportsFraction", "true")
        element.set("resolution", str(NANOSECONDS))
        element.set("intervalCounter", str(terminal.period_ns))
        element.set("shiftCounter", str(terminal.shift_ns))
    else:
        element.set("intervalVariability", "countdown")
        element.set("supportsFraction", "true")
        element.set("resolution", str(NANOSECONDS))


def terminals(interface: Interface) -> str:
    """Text of terminalsAndIcons.xml."""
    root = Xml.Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    parent = Xml.SubElement(root, "Terminals")
    for terminal in interface.terminals:
        element = Xml.SubElement(
            parent,
            "Terminal",
            terminalKind="org.fmi-ls-bus.network-terminal",
            name=terminal.name,
            matchingRule="org.fmi-ls-bus.transceiver",
            description=terminal.description,
        )
        for role in (TX_DATA, TX_CLOCK, RX_DATA, RX_CLOCK):
            Xml.SubElement(
                element,
                "TerminalMemberVariable",
                variableKind="signal",
                variableName=f"{terminal.name}.{role}",
                memberName=role,
            )
    return _text(root)


def manifest(interface: Interface) -> str:
    """Text of the manifest of fmi-ls-bus."""
    kind = "true" if interface.bus else "false"
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        "<fmiLayeredStandardManifest\n"
        '    xmlns:fmi-ls="http://fmi-standard.org/fmi-ls-manifest"\n'
        f'    fmi-ls:fmi-ls-name="{LS_BUS}"\n'
        f'    fmi-ls:fmi-ls-version="{LS_BUS_VERSION}"\n'
        '    fmi-ls:fmi-ls-description="Bus communication, network abstraction (low cut)"\n'
        f'    isBusSimulationFMU="{kind}"/>\n'
    )


def build_description(identifier: str, sources: Iterable[str], options: str) -> str:
    """Text of buildDescription.xml."""
    root = Xml.Element("fmiBuildDescription", fmiVersion="3.0")
    build = Xml.SubElement(root, "BuildConfiguration", modelIdentifier=identifier)
    files = Xml.SubElement(build, "SourceFileSet", language="C99", compilerOptions=options)
    for name in sorted(sources):
        if name.endswith(".c"):
            Xml.SubElement(files, "SourceFile", name=name)
    Xml.SubElement(build, "Library", name="m")
    return _text(root)


def _number(value: float) -> str:
    return str(value) if isinstance(value, int) else repr(float(f"{value:.15g}"))


def _text(root: Xml.Element) -> str:
    Xml.indent(root)
    text: str = Xml.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'
