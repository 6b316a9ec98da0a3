/* QEMU TCG plugin: instructions between the functions at start= and end=, one line a visit. With
   costs=, a file of "address cycles conditional" lines in hexadecimal, also cycles: those of each
   instruction, and refill= more for each conditional branch taken.
   QEMU's packages bring no header, so the few functions of its plugin API, version 1, are declared
   here. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef uint64_t plugin_id;
struct qemu_plugin_tb;
struct qemu_plugin_insn;
extern void qemu_plugin_register_vcpu_tb_trans_cb(
    plugin_id, void (*)(plugin_id, struct qemu_plugin_tb *));
extern size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *);
extern struct qemu_plugin_insn *qemu_plugin_tb_get_insn(const struct qemu_plugin_tb *, size_t);
extern uint64_t qemu_plugin_insn_vaddr(const struct qemu_plugin_insn *);
extern uint64_t qemu_plugin_tb_vaddr(const struct qemu_plugin_tb *);
extern size_t qemu_plugin_insn_size(const struct qemu_plugin_insn *);
extern void qemu_plugin_register_vcpu_tb_exec_cb(
    struct qemu_plugin_tb *, void (*)(unsigned, void *), int, void *);
extern void qemu_plugin_register_vcpu_insn_exec_cb(
    struct qemu_plugin_insn *, void (*)(unsigned, void *), int, void *);
extern void qemu_plugin_register_vcpu_insn_exec_inline(
    struct qemu_plugin_insn *, int, void *, uint64_t);
extern void qemu_plugin_register_atexit_cb(plugin_id, void (*)(plugin_id, void *), void *);

#define EXPORT __attribute__((visibility("default")))
EXPORT int qemu_plugin_version = 1;
EXPORT int qemu_plugin_install(plugin_id, const void *, int, char **);

/* Flash is at 0 and small; an odd address is never one of an instruction. */
#define FLASH 0x40000
typedef struct {
    uint64_t start, end;
    int conditional;
} block;

static uint64_t total, began, cycles, cycles_began, start, end, refill;
static uint8_t cost[FLASH], conditional[FLASH];
static const block *before;
static int costs;
static FILE *out;

static void on_start(unsigned cpu, void *data)
{
    (void)cpu;
    (void)data;
    began = total;
    cycles_began = cycles;
}
static void on_block(unsigned cpu, void *data)
{
    const block *now = data;
    (void)cpu;
    if (before && before->conditional && now->start != before->end) cycles += refill;
    before = now;
}
static void on_end(unsigned cpu, void *data)
{
    (void)cpu;
    (void)data;
    fprintf(out, "%llu", (unsigned long long)(total - began));
    if (costs) fprintf(out, " %llu", (unsigned long long)(cycles - cycles_began));
    fputc('\n', out);
}

static void translate(plugin_id id, struct qemu_plugin_tb *translated)
{
    (void)id;
    size_t n = qemu_plugin_tb_n_insns(translated);
    if (costs) {
        struct qemu_plugin_insn *last = qemu_plugin_tb_get_insn(translated, n - 1);
        uint64_t address = qemu_plugin_insn_vaddr(last);
        block *kept = malloc(sizeof *kept);
        kept->start = qemu_plugin_tb_vaddr(translated);
        kept->end = address + qemu_plugin_insn_size(last);
        kept->conditional = address < FLASH && conditional[address];
        qemu_plugin_register_vcpu_tb_exec_cb(translated, on_block, 0, kept);
    }
    for (size_t i = 0; i < n; i++) {
        struct qemu_plugin_insn *instruction = qemu_plugin_tb_get_insn(translated, i);
        uint64_t address = qemu_plugin_insn_vaddr(instruction);
        if (address == start) qemu_plugin_register_vcpu_insn_exec_cb(instruction, on_start, 0, 0);
        if (address == end) qemu_plugin_register_vcpu_insn_exec_cb(instruction, on_end, 0, 0);
        qemu_plugin_register_vcpu_insn_exec_inline(instruction, 0, &total, 1);
        if (costs && address < FLASH) {
            qemu_plugin_register_vcpu_insn_exec_inline(instruction, 0, &cycles, cost[address]);
        }
    }
}

static void read_costs(const char *name)
{
    unsigned address, own, branch;
    FILE *file = fopen(name, "r");
    while (file && fscanf(file, "%x %x %x", &address, &own, &branch) == 3) {
        if (address >= FLASH) continue;
        cost[address] = (uint8_t)own;
        conditional[address] = (uint8_t)branch;
    }
    costs = file != NULL;
    if (file) fclose(file);
}

static void at_exit(plugin_id id, void *data) { (void)id; (void)data; fclose(out); }

EXPORT int qemu_plugin_install(plugin_id id, const void *info, int count, char **arguments)
{
    const char *name = "instructions.txt";
    (void)info;
    for (int i = 0; i < count; i++) {
        if (!strncmp(arguments[i], "start=", 6)) start = strtoull(arguments[i] + 6, 0, 0);
        if (!strncmp(arguments[i], "end=", 4)) end = strtoull(arguments[i] + 4, 0, 0);
        if (!strncmp(arguments[i], "out=", 4)) name = strdup(arguments[i] + 4);
        if (!strncmp(arguments[i], "refill=", 7)) refill = strtoull(arguments[i] + 7, 0, 0);
        if (!strncmp(arguments[i], "costs=", 6)) read_costs(arguments[i] + 6);
    }
    out = fopen(name, "w");
    if (!out) return 1;
    qemu_plugin_register_vcpu_tb_trans_cb(id, translate);
    qemu_plugin_register_atexit_cb(id, at_exit, 0);
    return 0;
}
