/* QEMU TCG plugin: instructions between the functions at start= and end=, one line a visit.
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
extern void qemu_plugin_register_vcpu_insn_exec_cb(
    struct qemu_plugin_insn *, void (*)(unsigned, void *), int, void *);
extern void qemu_plugin_register_vcpu_insn_exec_inline(
    struct qemu_plugin_insn *, int, void *, uint64_t);
extern void qemu_plugin_register_atexit_cb(plugin_id, void (*)(plugin_id, void *), void *);

#define EXPORT __attribute__((visibility("default")))
EXPORT int qemu_plugin_version = 1;
EXPORT int qemu_plugin_install(plugin_id, const void *, int, char **);

static uint64_t total, began, start, end;
static FILE *out;

static void on_start(unsigned cpu, void *data) { (void)cpu; (void)data; began = total; }
static void on_end(unsigned cpu, void *data)
{
    (void)cpu;
    (void)data;
    fprintf(out, "%llu\n", (unsigned long long)(total - began));
}

static void translate(plugin_id id, struct qemu_plugin_tb *block)
{
    (void)id;
    size_t n = qemu_plugin_tb_n_insns(block);
    for (size_t i = 0; i < n; i++) {
        struct qemu_plugin_insn *instruction = qemu_plugin_tb_get_insn(block, i);
        uint64_t address = qemu_plugin_insn_vaddr(instruction);
        if (address == start) qemu_plugin_register_vcpu_insn_exec_cb(instruction, on_start, 0, 0);
        if (address == end) qemu_plugin_register_vcpu_insn_exec_cb(instruction, on_end, 0, 0);
        qemu_plugin_register_vcpu_insn_exec_inline(instruction, 0, &total, 1);
    }
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
    }
    out = fopen(name, "w");
    if (!out) return 1;
    qemu_plugin_register_vcpu_tb_trans_cb(id, translate);
    qemu_plugin_register_atexit_cb(id, at_exit, 0);
    return 0;
}
