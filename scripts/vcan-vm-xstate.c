/* Preloaded into user-mode-linux, whose buffer for the registers of a process ends after AVX-512.
 *
 * Linux takes back only all of a processor's extended state, which is longer where there is AMX. The
 * guest cannot use AMX, so that nothing is lost if that is in its initial state. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <stdarg.h>
#include <stdint.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

enum { XSTATE = 0x202, MOST = 1 << 16, IN_USE = 512 };

long ptrace(enum __ptrace_request request, ...)
{
    static long (*real)(enum __ptrace_request, ...);
    static uint64_t whole[MOST / sizeof(uint64_t)];
    va_list rest;
    va_start(rest, request);
    pid_t pid = va_arg(rest, pid_t);
    void *address = va_arg(rest, void *);
    void *data = va_arg(rest, void *);
    va_end(rest);
    if (real == NULL)
        real = (long (*)(enum __ptrace_request, ...))dlsym(RTLD_NEXT, "ptrace");
    if (request != PTRACE_SETREGSET || (uintptr_t)address != XSTATE)
        return real(request, pid, address, data);
    struct iovec all = {whole, sizeof whole};
    const struct iovec *given = data;
    if (real(PTRACE_GETREGSET, pid, address, &all) != 0)
        return -1;
    if (given->iov_len < all.iov_len) {
        uint64_t *in_use = &whole[IN_USE / sizeof(uint64_t)];
        const uint64_t components = 0xff | 1 << 9; /* up to AVX-512, and PKRU */
        memset((char *)whole + given->iov_len, 0, all.iov_len - given->iov_len);
        memcpy(whole, given->iov_base, given->iov_len);
        *in_use &= components;
        return real(request, pid, address, &all);
    }
    return real(request, pid, address, data);
}
